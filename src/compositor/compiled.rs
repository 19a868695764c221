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
#[derive(Clone, Debug, PartialEq, Eq)]
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

/// A pipeline is found by its shader and by a text that tells all else in which pipelines of this
/// shader differ.
#[derive(Debug, Default)]
struct Compiled {
    /// Shaders and pipelines that were compiled so far, those that were let go included.
    shader_count: usize,
    pipeline_count: usize,
    /// By text, with the number under which the shader is known.
    shaders: HashMap<String, (usize, wgpu::ShaderModule)>,
    render: HashMap<(usize, String), wgpu::RenderPipeline>,
    compute: HashMap<(usize, String), wgpu::ComputePipeline>,
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

    /// The render pipeline `key` of `shader`; `compile` makes it of the module if there is none yet.
    pub(crate) fn render_pipeline(
        &self,
        shader: &Shader,
        key: String,
        compile: impl FnOnce(&wgpu::ShaderModule) -> wgpu::RenderPipeline,
    ) -> wgpu::RenderPipeline {
        self.pipeline(shader, key, |compiled| &mut compiled.render, compile)
    }

    /// The compute pipeline `key` of `shader`; `compile` makes it of the module if there is none yet.
    pub(crate) fn compute_pipeline(
        &self,
        shader: &Shader,
        key: String,
        compile: impl FnOnce(&wgpu::ShaderModule) -> wgpu::ComputePipeline,
    ) -> wgpu::ComputePipeline {
        self.pipeline(shader, key, |compiled| &mut compiled.compute, compile)
    }

    /// Nothing waits for a pipeline that another thread compiles: of two threads that want the same
    /// one at once, both compile it.
    fn pipeline<P: Clone>(
        &self,
        shader: &Shader,
        key: String,
        of: impl Fn(&mut Compiled) -> &mut HashMap<(usize, String), P>,
        compile: impl FnOnce(&wgpu::ShaderModule) -> P,
    ) -> P {
        let (number, module) = self.module(shader);
        let key = (number, key);
        if let Some(known) = self.with(|compiled| of(compiled).get(&key).cloned()) {
            return known;
        }
        let pipeline = compile(&module);
        self.with(|compiled| {
            compiled.bound();
            compiled.pipeline_count += 1;
            of(compiled).insert(key, pipeline.clone());
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
