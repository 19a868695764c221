//! glTF materials and their textures.

use super::check::LARGEST_TEXTURE;
use super::gltf_bytes::{Fault, Resolver, Source, follow, one_line};
use super::{Material, SceneTexture};
use glam::{Mat2, Vec2, Vec3, Vec4};
use gltf::material::AlphaMode;
use image::ImageReader;
use std::collections::HashMap;
use std::io::Cursor;
use std::sync::Arc;

/// Bytes that one decoded texture may take.
const TEXTURE_BYTES: u64 = 4 * (LARGEST_TEXTURE as u64) * (LARGEST_TEXTURE as u64);

/// Which texture coordinates a material wants, and how they are moved
/// (KHR_texture_transform). A vertex has room for one set: the first texture decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvSource {
    pub set: u32,
    offset: Vec2,
    turn_and_scale: Mat2,
}

impl Default for UvSource {
    fn default() -> Self {
        Self {
            set: 0,
            offset: Vec2::ZERO,
            turn_and_scale: Mat2::IDENTITY,
        }
    }
}

impl UvSource {
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        self.turn_and_scale * uv + self.offset
    }

    fn of(info: &gltf::texture::Info) -> Self {
        let Some(t) = info.texture_transform() else {
            return Self {
                set: info.tex_coord(),
                ..Self::default()
            };
        };
        // The extension's rotation turns counter-clockwise in a frame whose v points down.
        let (sin, cos) = t.rotation().sin_cos();
        let [sx, sy] = t.scale();
        Self {
            set: t.tex_coord().unwrap_or(info.tex_coord()),
            offset: Vec2::from(t.offset()),
            turn_and_scale: Mat2::from_cols_array(&[cos * sx, -sin * sx, sin * sy, cos * sy]),
        }
    }
}

/// A material as it is drawn, and the texture coordinates it needs.
#[derive(Clone)]
pub(super) struct Look {
    pub material: Arc<Material>,
    pub uv: UvSource,
}

/// Reads each material and each image once.
pub(super) struct Materials<'s, 'b> {
    source: &'s Source<'b>,
    resolve: &'s Resolver<'s>,
    file: &'s str,
    looks: HashMap<Option<usize>, Look>,
    images: HashMap<usize, Arc<SceneTexture>>,
}

impl<'s, 'b> Materials<'s, 'b> {
    pub(super) fn new(source: &'s Source<'b>, resolve: &'s Resolver<'s>, file: &'s str) -> Self {
        Self {
            source,
            resolve,
            file,
            looks: HashMap::new(),
            images: HashMap::new(),
        }
    }

    pub(super) fn look(&mut self, material: &gltf::Material) -> Result<Look, Fault> {
        if let Some(known) = self.looks.get(&material.index()) {
            return Ok(known.clone());
        }
        let look = self.read(material)?;
        self.looks.insert(material.index(), look.clone());
        Ok(look)
    }

    fn read(&mut self, m: &gltf::Material) -> Result<Look, Fault> {
        let pbr = m.pbr_metallic_roughness();
        let emission = m.emissive_strength().unwrap_or(1.0);
        let mut out = Material {
            base_colour: Vec4::from(pbr.base_color_factor()),
            metallic: pbr.metallic_factor().clamp(0.0, 1.0),
            roughness: pbr.roughness_factor().clamp(0.0, 1.0),
            specular: m.specular().map_or(1.0, |s| s.specular_factor()),
            emissive: Vec3::from(m.emissive_factor()) * emission,
            double_sided: m.double_sided(),
            alpha_cutoff: self.alpha_cutoff(m),
            base_colour_texture: self.optional(pbr.base_color_texture().map(|t| t.texture()))?,
            metallic_roughness_texture: self
                .optional(pbr.metallic_roughness_texture().map(|t| t.texture()))?,
            normal_texture: self.optional(m.normal_texture().map(|t| t.texture()))?,
            normal_scale: m.normal_texture().map_or(1.0, |t| t.scale()),
            occlusion_texture: self.optional(m.occlusion_texture().map(|t| t.texture()))?,
            emissive_texture: self.optional(m.emissive_texture().map(|t| t.texture()))?,
        };
        if let Some(strength) = m.occlusion_texture().map(|t| t.strength()) {
            weaken_occlusion(&mut out, strength);
        }
        let numbers = [out.metallic, out.roughness, out.specular, out.normal_scale];
        if !(out.base_colour.is_finite() && out.emissive.is_finite())
            || numbers.iter().any(|x| !x.is_finite())
        {
            return Err(format!(
                "material {:?} is not finite; export it again",
                m.name()
            ));
        }
        let uv = self.uv_source(m);
        Ok(Look {
            material: Arc::new(out),
            uv,
        })
    }

    /// Blending needs sorted surfaces, which the shadow maps cannot follow: blended
    /// materials are cut out at one half instead.
    fn alpha_cutoff(&self, m: &gltf::Material) -> f32 {
        match m.alpha_mode() {
            AlphaMode::Opaque => 0.0,
            AlphaMode::Mask => m.alpha_cutoff().unwrap_or(0.5).clamp(0.0, 1.0),
            AlphaMode::Blend => {
                tracing::warn!(file = self.file, material = ?m.name(), "blended material is cut out at alpha 0.5");
                0.5
            }
        }
    }

    fn uv_source(&self, m: &gltf::Material) -> UvSource {
        let pbr = m.pbr_metallic_roughness();
        let set_only = |set: u32| UvSource {
            set,
            ..UvSource::default()
        };
        let wanted: Vec<UvSource> = [
            pbr.base_color_texture().map(|t| UvSource::of(&t)),
            pbr.metallic_roughness_texture().map(|t| UvSource::of(&t)),
            m.emissive_texture().map(|t| UvSource::of(&t)),
            m.normal_texture().map(|t| set_only(t.tex_coord())),
            m.occlusion_texture().map(|t| set_only(t.tex_coord())),
        ]
        .into_iter()
        .flatten()
        .collect();
        let first = wanted.first().copied().unwrap_or_default();
        let sets = wanted.iter().any(|w| w.set != first.set);
        if sets
            || wanted
                .iter()
                .take(3)
                .any(|w| *w != first && *w != set_only(first.set))
        {
            tracing::warn!(file = self.file, material = ?m.name(), "its textures use different coordinates; the first one's are used for all");
        }
        first
    }

    fn optional(
        &mut self,
        texture: Option<gltf::Texture>,
    ) -> Result<Option<Arc<SceneTexture>>, Fault> {
        texture.map(|t| self.image(t.source().index())).transpose()
    }

    fn image(&mut self, index: usize) -> Result<Arc<SceneTexture>, Fault> {
        if let Some(known) = self.images.get(&index) {
            return Ok(known.clone());
        }
        let json = self.source.document.as_json();
        let entry = json
            .images
            .get(index)
            .ok_or("a texture without image; export it again")?;
        let decoded = match (&entry.buffer_view, &entry.uri) {
            (Some(view), _) => decode(self.source.view(view.value())?),
            (None, Some(uri)) => decode(&follow(uri, self.resolve)?),
            (None, None) => Err("it has no data; export it again".into()),
        };
        let texture = Arc::new(decoded.map_err(|e| format!("image {index}: {e}"))?);
        self.images.insert(index, texture.clone());
        Ok(texture)
    }
}

/// PNG or JPEG bytes to RGBA8.
pub(super) fn decode(bytes: &[u8]) -> Result<SceneTexture, Fault> {
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(LARGEST_TEXTURE);
    limits.max_image_height = Some(LARGEST_TEXTURE);
    limits.max_alloc = Some(TEXTURE_BYTES);
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| one_line(&e.to_string()))?;
    if !matches!(
        reader.format(),
        Some(image::ImageFormat::Png | image::ImageFormat::Jpeg)
    ) {
        return Err("neither PNG nor JPEG; convert it".into());
    }
    reader.limits(limits);
    let picture = reader
        .decode()
        .map_err(|e| {
            format!(
                "{} (PNG or JPEG, at most {LARGEST_TEXTURE} a side)",
                one_line(&e.to_string())
            )
        })?
        .into_rgba8();
    Ok(SceneTexture {
        width: picture.width(),
        height: picture.height(),
        rgba: picture.into_raw(),
    })
}

/// Bakes `occlusionTexture.strength` into the texture: 1 + strength · (occlusion − 1).
fn weaken_occlusion(material: &mut Material, strength: f32) {
    if (strength - 1.0).abs() < 1e-6 || !strength.is_finite() {
        return;
    }
    if let Some(texture) = &mut material.occlusion_texture {
        let mut copy = (**texture).clone();
        for red in copy.rgba.iter_mut().step_by(4) {
            let occlusion = f32::from(*red) / 255.0;
            *red = (255.0 * (1.0 + strength * (occlusion - 1.0)))
                .clamp(0.0, 255.0)
                .round() as u8;
        }
        *texture = Arc::new(copy);
    }
}
