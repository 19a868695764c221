//! Reads glTF materials and their textures.

use super::check::MAX_TEXTURE_SIZE;
use super::gltf_bytes::{Fault, Resolver, Source, follow, one_line};
use super::photometric::luminance;
use crate::mesh::{Material, SceneTexture};
use glam::{Mat2, Vec2, Vec3, Vec4};
use gltf::material::AlphaMode;
use image::{ImageFormat, ImageReader};
use std::collections::{BTreeSet, HashMap};
use std::io::Cursor;
use std::sync::Arc;

/// Maximum size of all decoded textures of a file, bytes: a PNG of one colour is compressed by a
/// factor of a thousand, so the file's size is no limit.
const TEXTURE_BYTES: u64 = 1 << 29;

/// The set of texture coordinates of a material and its transform (KHR_texture_transform). A vertex
/// has one set: that of the first texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvSource {
    pub set: u32,
    offset: Vec2,
    linear: Mat2,
}

impl Default for UvSource {
    fn default() -> Self {
        Self {
            set: 0,
            offset: Vec2::ZERO,
            linear: Mat2::IDENTITY,
        }
    }
}

impl UvSource {
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        self.linear * uv + self.offset
    }

    fn from_info(info: &gltf::texture::Info) -> Self {
        let Some(t) = info.texture_transform() else {
            return Self {
                set: info.tex_coord(),
                ..Self::default()
            };
        };
        // The extension rotates counter-clockwise in a frame whose v points down.
        let (sin, cos) = t.rotation().sin_cos();
        let [sx, sy] = t.scale();
        Self {
            set: t.tex_coord().unwrap_or(info.tex_coord()),
            offset: Vec2::from(t.offset()),
            linear: Mat2::from_cols_array(&[cos * sx, -sin * sx, sin * sy, cos * sy]),
        }
    }
}

/// A material and its texture coordinates.
#[derive(Clone)]
pub(super) struct UvMaterial {
    pub material: Arc<Material>,
    pub uv: UvSource,
}

/// Reads and caches materials and images.
pub(super) struct Materials<'s, 'b> {
    source: &'s Source<'b>,
    resolve: &'s Resolver<'s>,
    file: &'s str,
    known: HashMap<Option<usize>, UvMaterial>,
    images: HashMap<usize, Arc<SceneTexture>>,
    bytes_left: u64,
    /// Properties of materials that are not carried.
    ignored: BTreeSet<&'static str>,
}

impl<'s, 'b> Materials<'s, 'b> {
    pub(super) fn new(source: &'s Source<'b>, resolve: &'s Resolver<'s>, file: &'s str) -> Self {
        Self {
            source,
            resolve,
            file,
            known: HashMap::new(),
            images: HashMap::new(),
            bytes_left: TEXTURE_BYTES,
            ignored: BTreeSet::new(),
        }
    }

    pub(super) fn material(&mut self, material: &gltf::Material) -> Result<UvMaterial, Fault> {
        if let Some(known) = self.known.get(&material.index()) {
            return Ok(known.clone());
        }
        let read = self.read(material)?;
        self.known.insert(material.index(), read.clone());
        Ok(read)
    }

    fn read(&mut self, m: &gltf::Material) -> Result<UvMaterial, Fault> {
        let pbr = m.pbr_metallic_roughness();
        let emission = m.emissive_strength().unwrap_or(1.0);
        let mut out = Material {
            base_colour: Vec4::from(pbr.base_color_factor()),
            metallic: pbr.metallic_factor().clamp(0.0, 1.0),
            roughness: pbr.roughness_factor().clamp(0.0, 1.0),
            specular: self.specular(m),
            emissive: Vec3::from(m.emissive_factor()) * emission,
            double_sided: m.double_sided(),
            alpha_cutoff: self.alpha_cutoff(m),
            phong: None,
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
        Ok(UvMaterial {
            material: Arc::new(out),
            uv,
        })
    }

    /// KHR_materials_specular as far as [`Material::specular`] carries it: `specularFactor` times the
    /// luminance of `specularColorFactor`, at most 1 (F0 = 4 %). Records what is ignored.
    fn specular(&mut self, m: &gltf::Material) -> f32 {
        let Some(specular) = m.specular() else {
            return 1.0;
        };
        let colour = Vec3::from(specular.specular_color_factor());
        let is_grey = colour == Vec3::splat(colour.x);
        let grey = if is_grey { colour.x } else { luminance(colour) };
        let factor = specular.specular_factor() * grey;
        let ignored = [
            ("specularTexture", specular.specular_texture().is_some()),
            (
                "specularColorTexture",
                specular.specular_color_texture().is_some(),
            ),
            ("the hue of specularColorFactor", !is_grey),
            ("specularColorFactor above 1", factor > 1.0),
        ];
        let ignored = ignored.into_iter().filter(|(_, is_used)| *is_used);
        self.ignored.extend(ignored.map(|(what, _)| what));
        factor.min(1.0)
    }

    /// One line that names the ignored properties of the file's materials; `None` without any.
    pub(super) fn warning(&self) -> Option<String> {
        let ignored: Vec<&str> = self.ignored.iter().copied().collect();
        (!ignored.is_empty()).then(|| {
            format!(
                "{}: KHR_materials_specular: {} ignored; bake the reflection into metallic and roughness",
                self.file,
                ignored.join(", "),
            )
        })
    }

    /// Minimum alpha. Blending needs sorted surfaces, which shadow maps cannot have: blended materials
    /// are cut out at 0.5 instead.
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
            pbr.base_color_texture().map(|t| UvSource::from_info(&t)),
            pbr.metallic_roughness_texture()
                .map(|t| UvSource::from_info(&t)),
            m.emissive_texture().map(|t| UvSource::from_info(&t)),
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
            tracing::warn!(file = self.file, material = ?m.name(), "its textures use different coordinates; those of the first texture are used for all");
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
            (Some(view), _) => decode(self.source.view(view.value())?, self.bytes_left),
            (None, Some(uri)) => decode(&follow(uri, self.resolve)?, self.bytes_left),
            (None, None) => Err("it has no data; export it again".into()),
        };
        let texture = Arc::new(decoded.map_err(|e| format!("image {index}: {e}"))?);
        self.bytes_left = self.bytes_left.saturating_sub(texture.rgba.len() as u64);
        self.images.insert(index, texture.clone());
        Ok(texture)
    }
}

/// Decodes a PNG or JPEG to RGBA8 of at most `max_bytes`.
///
/// # Errors
/// It is damaged, of another format or too large.
pub(super) fn decode(bytes: &[u8], max_bytes: u64) -> Result<SceneTexture, Fault> {
    let unreadable = |e: image::ImageError| one_line(&e.to_string());
    let open = || {
        ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| one_line(&e.to_string()))
    };
    let mut reader = open()?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err("neither PNG nor JPEG; convert it".into());
    }
    let (width, height) = open()?.into_dimensions().map_err(unreadable)?;
    let size = 4 * u64::from(width) * u64::from(height);
    if width.max(height) > MAX_TEXTURE_SIZE || size > max_bytes {
        return Err(format!(
            "{width}x{height} is too large (at most {MAX_TEXTURE_SIZE} a side, 512 MiB together); scale it down"
        ));
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(max_bytes.saturating_mul(2));
    reader.limits(limits);
    let picture = reader.decode().map_err(unreadable)?.into_rgba8();
    Ok(SceneTexture {
        width: picture.width(),
        height: picture.height(),
        rgba: picture.into_raw(),
    })
}

/// Applies `occlusionTexture.strength` to the texture: 1 + strength · (occlusion − 1).
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

#[cfg(test)]
mod tests {
    use super::*;

    fn grey_png(width: u32, height: u32) -> Vec<u8> {
        let mut png = Vec::new();
        image::GrayImage::from_pixel(width, height, image::Luma([51]))
            .write_to(&mut Cursor::new(&mut png), ImageFormat::Png)
            .unwrap();
        png
    }

    #[test]
    fn decodes_grey_textures_to_rgba() {
        let texture = decode(&grey_png(2, 1), 8).unwrap();
        assert_eq!(texture.rgba, [51, 51, 51, 255, 51, 51, 51, 255]);
    }

    #[test]
    fn refuses_large_textures_before_decoding() {
        let text = decode(&grey_png(3, 1), 11).unwrap_err();
        assert!(text.contains("3x1 is too large"), "{text}");
        let text = decode(&grey_png(MAX_TEXTURE_SIZE + 1, 1), u64::MAX).unwrap_err();
        assert!(text.contains("too large"), "{text}");
        assert!(
            decode(b"GIF89a", 1000)
                .unwrap_err()
                .contains("neither PNG nor JPEG")
        );
    }

    #[test]
    fn applies_occlusion_strength_to_the_texture() {
        let texture = SceneTexture {
            width: 1,
            height: 1,
            rgba: vec![0, 1, 2, 3],
        };
        let mut material = Material {
            occlusion_texture: Some(Arc::new(texture)),
            ..Material::default()
        };
        weaken_occlusion(&mut material, 0.6);
        // 1 + 0.6 · (0 − 1) = 0.4; only red changes.
        assert_eq!(material.occlusion_texture.unwrap().rgba, [102, 1, 2, 3]);
    }
}
