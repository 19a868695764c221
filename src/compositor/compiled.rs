//! The device, which keeps what was compiled on it.
//!
//! A software driver compiles a large shader in tenths of a second. Settings are changed back and
//! forth, scenes gain and lose lamps, and a compositor may be created anew: what was compiled once
//! is found again.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

/// Pipelines that are kept: seven variants of all passes. All are let go when there are
/// more, because the text of some shaders depends on the size of a bake.
const MAX_PIPELINES: usize = 256;

/// A shader's name and WGSL text. It is compiled when the first pipeline needs it.
#[derive(Clone, Debug)]
pub struct Shader {
    pub label: String,
    pub text: String,
}

/// A logical device, and the pipelines that were compiled on it. Clones share them.
#[derive(Clone, Debug)]
pub struct Device {
    device: wgpu::Device,
    compiled: Arc<Mutex<Compiled>>,
}

/// Pipelines by the number of their shader, and by a text that tells all else in which pipelines of
/// this shader differ.
type Kept<P> = HashMap<(usize, String), P>;

#[derive(Debug, Default)]
pub(crate) struct Compiled {
    /// Shaders and pipelines that were compiled so far, those that were let go included.
    shader_count: usize,
    pipeline_count: usize,
    /// By text, with the number under which the shader is known.
    shaders: HashMap<String, (usize, wgpu::ShaderModule)>,
    render: Kept<wgpu::RenderPipeline>,
    compute: Kept<wgpu::ComputePipeline>,
}

/// A kind of pipeline.
pub(crate) trait Pipeline: Clone {
    /// Those of this kind that are kept.
    fn kept(compiled: &mut Compiled) -> &mut Kept<Self>;
}

impl Pipeline for wgpu::RenderPipeline {
    fn kept(compiled: &mut Compiled) -> &mut Kept<Self> {
        &mut compiled.render
    }
}

impl Pipeline for wgpu::ComputePipeline {
    fn kept(compiled: &mut Compiled) -> &mut Kept<Self> {
        &mut compiled.compute
    }
}

impl Compiled {
    fn bound(&mut self) {
        if self.render.len() + self.compute.len() >= MAX_PIPELINES {
            *self = Self {
                shader_count: self.shader_count,
                pipeline_count: self.pipeline_count,
                ..Self::default()
            };
        }
    }
}

impl Deref for Device {
    type Target = wgpu::Device;

    fn deref(&self) -> &wgpu::Device {
        &self.device
    }
}

impl PartialEq for Device {
    fn eq(&self, other: &Self) -> bool {
        self.device == other.device
    }
}

impl Device {
    /// A device on which nothing was compiled yet.
    #[must_use]
    pub fn new(device: wgpu::Device) -> Self {
        Self {
            device,
            compiled: Arc::default(),
        }
    }

    /// Number of pipelines that were compiled since the device was opened.
    #[must_use]
    pub fn pipelines_compiled(&self) -> usize {
        self.with(|compiled| compiled.pipeline_count)
    }

    /// The pipeline `key` of `shader`; `compile` makes it of the module if there is none yet.
    ///
    /// Nothing waits for a pipeline that another thread compiles: of two threads that want the same
    /// one at once, both compile it.
    pub(crate) fn pipeline<P: Pipeline>(
        &self,
        shader: &Shader,
        key: String,
        compile: impl FnOnce(&wgpu::ShaderModule) -> P,
    ) -> P {
        let (number, module) = self.module(shader);
        let key = (number, key);
        if let Some(known) = self.with(|compiled| P::kept(compiled).get(&key).cloned()) {
            return known;
        }
        let pipeline = compile(&module);
        self.with(|compiled| {
            compiled.bound();
            compiled.pipeline_count += 1;
            P::kept(compiled).insert(key, pipeline.clone());
        });
        pipeline
    }

    fn module(&self, shader: &Shader) -> (usize, wgpu::ShaderModule) {
        if let Some(known) = self.with(|compiled| compiled.shaders.get(&shader.text).cloned()) {
            return known;
        }
        let module = self
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(&shader.label),
                source: wgpu::ShaderSource::Wgsl(shader.text.as_str().into()),
            });
        self.with(|compiled| {
            compiled.shader_count += 1;
            let number = compiled.shader_count;
            let known = compiled.shaders.entry(shader.text.clone());
            known.or_insert((number, module)).clone()
        })
    }

    fn with<T>(&self, act: impl FnOnce(&mut Compiled) -> T) -> T {
        act(&mut self.compiled.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
