//! The text of shaders: the file of a pass after the library files that it uses.

use super::compiled::Shader;
use super::lamp_maps::MAX_VIEWS;
use super::look::{CELL, MAX_TAPS, grain};
use super::planes::options::MAX_SOURCES;
use super::response_table::ENCODING;
use penumbra_lighting::light::MAX_COMPACT_SOURCES;
use penumbra_lighting::place::MAX_NEAR_LIGHTS;
use penumbra_scene::lamps::MAX_LAMPS;
use penumbra_scene::{Scene, VirtualLight, VirtualLightKind};

const FRAME: &str = include_str!("shaders/lib/frame.wgsl");
const NORMAL: &str = include_str!("shaders/lib/normal.wgsl");
const FULLSCREEN: &str = include_str!("shaders/lib/fullscreen.wgsl");
const TILES: &str = include_str!("shaders/lib/tiles.wgsl");
const SURFACE: &str = include_str!("shaders/lib/surface.wgsl");
const SAMPLES: &str = include_str!("shaders/lib/samples.wgsl");
const CODES: &str = include_str!("shaders/lib/codes.wgsl");
const CUBIC: &str = include_str!("shaders/lib/cubic.wgsl");
const EXPOSED: &str = include_str!("shaders/lib/exposed.wgsl");
const LIGHT_TEXEL: &str = include_str!("shaders/lib/light_texel.wgsl");
const LAMPS: &str = include_str!("shaders/lib/lamps.wgsl");
const LAMP_RESPONSE: &str = include_str!("shaders/lib/lamp_response.wgsl");
const ADDED_LIGHT: &str = include_str!("shaders/lib/added_light.wgsl");
const AREA_LAMPS: &str = include_str!("shaders/lib/area_lamps.wgsl");
const GLOSS: &str = include_str!("shaders/lib/gloss.wgsl");
const COMPACT_SOURCE_SPECULAR: &str = include_str!("shaders/lib/compact_source_specular.wgsl");
const HIGHLIGHTS: &str = include_str!("shaders/lib/highlights.wgsl");
const NEARBY: &str = include_str!("shaders/lib/nearby.wgsl");
const EDGES: &str = include_str!("shaders/lib/edges.wgsl");
const BACKGROUND: &str = include_str!("shaders/lib/background.wgsl");
const MARKS: &str = include_str!("shaders/lib/marks.wgsl");
const TABLE_BY_NORMAL: &str = include_str!("shaders/lib/by_normal.wgsl");
const SURFACE_CACHE: &str = include_str!("shaders/lib/surface_cache.wgsl");
const KEPT_ON_REAL: &str = include_str!("shaders/lib/kept_on_real.wgsl");
const IRRADIANCE: &str = include_str!("shaders/lib/irradiance.wgsl");
const PLANES: &str = include_str!("shaders/lib/planes.wgsl");
const LOOK: &str = include_str!("shaders/lib/look.wgsl");
const LOOK_REAL: &str = include_str!("shaders/lib/look_real.wgsl");
const LOOK_SPREAD: &str = include_str!("shaders/lib/look_spread.wgsl");
const VISIBILITY: &str = include_str!("shaders/lib/visibility.wgsl");

/// Maximum number of dome lights: as many as fit into a uniform buffer of 64 KiB.
pub const MAX_LIGHTS: u32 = 384;

/// The variant for which the text of shaders is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Samples a pixel of virtual surfaces.
    pub samples: u32,
    /// Look-ups of a shadow map per light and point; 1 = hard shadows.
    pub soft: u32,
    /// Whether there are lamps. Without them their code is omitted: software drivers run the body
    /// of a loop once even if there is nothing to iterate over.
    pub lamps: bool,
    /// Whether any lamp is a rectangle.
    pub areas: bool,
    /// Whether a material has Phong's lobe.
    pub phong: bool,
    /// Whether light is read from the surface cache.
    pub cached: bool,
    /// Whether the real picture is linear and in another exposure than the camera's.
    pub exposed: bool,
    /// Whether the camera has a rolling shutter.
    pub rolling_shutter: bool,
    /// Whether the camera has vignetting.
    pub vignetting: bool,
    /// Whether a surface is glossy.
    pub nearby: bool,
}

impl Variant {
    /// Whether phantoms are drawn with the change of the picture on them, because one look-up in the
    /// surface cache tells it, and no further pass is needed.
    pub const fn shadows_phantoms(self) -> bool {
        self.cached && !self.lamps
    }

    /// The variant that can show a scene, too.
    pub const fn with_scene(self, needs: SceneNeeds) -> Self {
        Self {
            lamps: self.lamps || needs.lamps,
            areas: self.areas || needs.areas,
            phong: self.phong || needs.phong,
            nearby: self.nearby || needs.nearby,
            ..self
        }
    }

    /// One sample, hard shadows, nothing optional.
    pub const PLAIN: Self = Self {
        samples: 1,
        soft: 1,
        lamps: false,
        areas: false,
        phong: false,
        cached: false,
        exposed: false,
        rolling_shutter: false,
        vignetting: false,
        nearby: false,
    };
}

/// What a scene needs of shaders.
#[derive(Clone, Copy, Debug, Default)]
pub struct SceneNeeds {
    /// As in [`Variant`].
    pub lamps: bool,
    /// As in [`Variant`].
    pub areas: bool,
    /// As in [`Variant`].
    pub phong: bool,
    /// As in [`Variant`].
    pub nearby: bool,
}

impl SceneNeeds {
    /// What `scene` needs; `nearby`: whether it has a glossy surface.
    pub fn of(scene: &Scene, nearby: bool) -> Self {
        let is_area = |lamp: &VirtualLight| matches!(lamp.kind, VirtualLightKind::Area { .. });
        Self {
            lamps: !scene.lamps.is_empty(),
            areas: scene.lamps.iter().any(is_area),
            phong: scene.has_phong(),
            nearby,
        }
    }
}

/// The shaders of a frame: name, and the parts of their text in order.
const FRAME_SHADERS: [(&str, &[&str]); 16] = [
    (
        "shadow_map",
        &[FRAME, include_str!("shaders/shadow_map.wgsl")],
    ),
    ("lamp_map", &[include_str!("shaders/lamp_map.wgsl")]),
    (
        "phantom_geometry",
        &[
            FRAME,
            NORMAL,
            TABLE_BY_NORMAL,
            SURFACE_CACHE,
            KEPT_ON_REAL,
            EDGES,
            IRRADIANCE,
            include_str!("shaders/phantom_geometry.wgsl"),
        ],
    ),
    (
        "virtual_geometry",
        &[
            FRAME,
            NORMAL,
            FULLSCREEN,
            SURFACE,
            TABLE_BY_NORMAL,
            SURFACE_CACHE,
            include_str!("shaders/virtual_geometry.wgsl"),
        ],
    ),
    (
        "shadow_buffer",
        &[
            FRAME,
            NORMAL,
            FULLSCREEN,
            TILES,
            SURFACE,
            SAMPLES,
            LIGHT_TEXEL,
            EDGES,
            MARKS,
            TABLE_BY_NORMAL,
            IRRADIANCE,
            VISIBILITY,
            LAMPS,
            LAMP_RESPONSE,
            AREA_LAMPS,
            include_str!("shaders/shadow_buffer.wgsl"),
        ],
    ),
    (
        "planes_shadow",
        &[
            FRAME,
            NORMAL,
            FULLSCREEN,
            TILES,
            SURFACE,
            SAMPLES,
            LIGHT_TEXEL,
            EDGES,
            MARKS,
            TABLE_BY_NORMAL,
            IRRADIANCE,
            LAMPS,
            LAMP_RESPONSE,
            AREA_LAMPS,
            PLANES,
            include_str!("shaders/planes_shadow.wgsl"),
        ],
    ),
    (
        "cached_shadow",
        &[
            FRAME,
            NORMAL,
            FULLSCREEN,
            TILES,
            SURFACE,
            SAMPLES,
            LIGHT_TEXEL,
            EDGES,
            MARKS,
            TABLE_BY_NORMAL,
            SURFACE_CACHE,
            KEPT_ON_REAL,
            IRRADIANCE,
            LAMPS,
            LAMP_RESPONSE,
            AREA_LAMPS,
            include_str!("shaders/cached_shadow.wgsl"),
        ],
    ),
    (
        "edge_tiles",
        &[
            FRAME,
            FULLSCREEN,
            TILES,
            EDGES,
            include_str!("shaders/edge_tiles.wgsl"),
        ],
    ),
    (
        "lamp_response",
        &[
            FRAME,
            CODES,
            LAMPS,
            AREA_LAMPS,
            LAMP_RESPONSE,
            include_str!("shaders/lamp_response.wgsl"),
        ],
    ),
    (
        "tiles",
        &[
            FRAME,
            NORMAL,
            FULLSCREEN,
            SURFACE,
            SAMPLES,
            LAMPS,
            AREA_LAMPS,
            include_str!("shaders/tiles.wgsl"),
        ],
    ),
    (
        "surroundings",
        &[
            FRAME,
            FULLSCREEN,
            CODES,
            EXPOSED,
            ADDED_LIGHT,
            include_str!("shaders/surroundings.wgsl"),
        ],
    ),
    (
        "composite",
        &[
            FRAME,
            NORMAL,
            TILES,
            SURFACE,
            SAMPLES,
            LIGHT_TEXEL,
            TABLE_BY_NORMAL,
            SURFACE_CACHE,
            CODES,
            EXPOSED,
            ADDED_LIGHT,
            EDGES,
            BACKGROUND,
            GLOSS,
            COMPACT_SOURCE_SPECULAR,
            LAMPS,
            AREA_LAMPS,
            HIGHLIGHTS,
            NEARBY,
            include_str!("shaders/composite.wgsl"),
        ],
    ),
    (
        "present",
        &[FULLSCREEN, include_str!("shaders/present.wgsl")],
    ),
    (
        "reproject",
        &[FULLSCREEN, CUBIC, include_str!("shaders/reproject.wgsl")],
    ),
    (
        "lens",
        &[
            FULLSCREEN,
            NORMAL,
            SURFACE,
            CODES,
            CUBIC,
            include_str!("shaders/lens.wgsl"),
        ],
    ),
    ("luminance", &[include_str!("shaders/luminance.wgsl")]),
];

fn join(parts: &[&str]) -> String {
    parts
        .join("\n")
        .replace("MAX_NEAR_LIGHTS", &MAX_NEAR_LIGHTS.to_string())
        .replace("MAX_LIGHTS", &MAX_LIGHTS.to_string())
        .replace("MAX_LAMP_VIEWS", &MAX_VIEWS.to_string())
        .replace("MAX_LAMPS", &MAX_LAMPS.to_string())
        .replace("MAX_COMPACT_SOURCES", &MAX_COMPACT_SOURCES.to_string())
        .replace("ENCODING_VECTORS", &(ENCODING / 4).to_string())
}

/// Replaces the names of `variant`'s constants and of the types of textures with one or several
/// samples, on which the same functions work in WGSL.
fn for_variant(text: String, variant: Variant) -> String {
    let (colour, depth) = if variant.samples > 1 {
        (
            "texture_multisampled_2d<u32>",
            "texture_depth_multisampled_2d",
        )
    } else {
        ("texture_2d<u32>", "texture_depth_2d")
    };
    let flags = [
        ("CACHED", variant.cached),
        ("LAMPED", variant.lamps),
        ("AREAS", variant.areas),
        ("PHONG", variant.phong),
        ("EXPOSED", variant.exposed),
        ("ROLLING", variant.rolling_shutter),
        ("VIGNETTING", variant.vignetting),
        ("NEARBY", variant.nearby),
    ];
    let text = only_cached(&text, variant.cached)
        .replace("VIRTUAL_TEXTURE", colour)
        .replace("VIRTUAL_DEPTH", depth)
        .replace("SAMPLES", &variant.samples.to_string())
        .replace("SOFT", &variant.soft.to_string());
    flags.iter().fold(text, |text, (name, set)| {
        text.replace(name, if *set { "true" } else { "false" })
    })
}

/// Keeps lines that begin with `IF_CACHED`, without that word, or drops them: structures cannot
/// depend on a constant.
fn only_cached(text: &str, cached: bool) -> String {
    let lines = text.lines().filter_map(|line| {
        let rest = line.trim_start().strip_prefix("IF_CACHED ");
        match rest {
            Some(rest) => cached.then_some(rest),
            None => Some(line),
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The shaders that change the exposure; `constants` are shared with the CPU.
#[must_use]
pub fn exposing(constants: &str) -> [(&'static str, String); 3] {
    let text = |own: &[&str]| {
        let parts = [
            &[constants, CODES, include_str!("shaders/lib/exposure.wgsl")],
            own,
        ]
        .concat();
        join(&parts)
    };
    [
        (
            "exposure_table",
            text(&[include_str!("shaders/exposure_table.wgsl")]),
        ),
        (
            "exposure",
            text(&[FULLSCREEN, include_str!("shaders/exposure.wgsl")]),
        ),
        (
            "exposure_meter",
            text(&[include_str!("shaders/exposure_meter.wgsl")]),
        ),
    ]
}

/// The properties for which the passes of the camera's look are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LookVariant {
    /// Samples a pixel of virtual surfaces.
    pub samples: u32,
    /// Whether the finished picture has the distortion of a lens.
    pub distorted: bool,
    /// Whether it is in another exposure than the camera's.
    pub exposed: bool,
    /// Whether points are spread over neighbouring pixels.
    pub spread: bool,
    /// Whether noise is added.
    pub grain: bool,
    /// Samples of a blur.
    pub taps: usize,
}

/// The shaders of the camera's look.
#[must_use]
pub fn look(variant: LookVariant) -> [(&'static str, String); 5] {
    let parts: [(&str, &[&str]); 5] = [
        (
            "look_tiles",
            &[FULLSCREEN, include_str!("shaders/look_tiles.wgsl")],
        ),
        (
            "look_layers",
            &[
                LOOK,
                NORMAL,
                SURFACE,
                CODES,
                LOOK_REAL,
                include_str!("shaders/look_layers.wgsl"),
            ],
        ),
        ("look_blur", &[LOOK, include_str!("shaders/look_blur.wgsl")]),
        (
            "look_spread",
            &[LOOK, LOOK_SPREAD, include_str!("shaders/look_spread.wgsl")],
        ),
        (
            "look_finish",
            &[
                LOOK,
                CODES,
                LOOK_REAL,
                LOOK_SPREAD,
                include_str!("shaders/look_finish.wgsl"),
            ],
        ),
    ];
    parts.map(|(name, parts)| (name, for_look(join(parts), variant)))
}

fn for_look(text: String, variant: LookVariant) -> String {
    let numbers = [
        ("GRAIN_SIDE", format!("{}u", grain::SIDE)),
        ("GRAIN_SIGMAS", format!("{:.1}", grain::MAX_SIGMAS)),
        ("MAX_TAPS", MAX_TAPS.to_string()),
        ("TAPS", variant.taps.to_string()),
        ("CELL", CELL.to_string()),
        ("DISTORTED", variant.distorted.to_string()),
        ("SPREAD", variant.spread.to_string()),
        ("GRAIN", variant.grain.to_string()),
    ];
    let text = numbers
        .iter()
        .fold(text, |text, (name, value)| text.replace(name, value));
    let frame = Variant {
        samples: variant.samples,
        exposed: variant.exposed,
        ..Variant::PLAIN
    };
    for_variant(text, frame)
}

/// The shader of the camera's look named `name`.
pub fn look_shader(name: &str, variant: LookVariant) -> Shader {
    named(name, look(variant))
}

/// The shaders that bake basis images of `resolution²` texels.
#[must_use]
pub fn baking(resolution: u32) -> [(&'static str, String); 4] {
    let text = |parts: &[&str]| {
        parts
            .join("\n")
            .replace("RESOLUTION", &format!("{resolution}u"))
    };
    [
        (
            "bake_receiver",
            text(&[NORMAL, include_str!("shaders/bake_receiver.wgsl")]),
        ),
        ("bake_map", text(&[include_str!("shaders/bake_map.wgsl")])),
        (
            "bake_evaluate",
            text(&[
                NORMAL,
                IMAGE_FLAGS,
                include_str!("shaders/bake_evaluate.wgsl"),
            ]),
        ),
        (
            "bake_source",
            text(&[
                SUM_PLANES,
                IMAGE_FLAGS,
                include_str!("shaders/bake_source.wgsl"),
            ]),
        ),
    ]
}

/// The shader that assigns lights of their own to compact sources.
#[must_use]
pub fn lighting() -> (&'static str, String) {
    let text = include_str!("shaders/planes_lights.wgsl");
    let sources = format!("{}u", MAX_SOURCES);
    ("planes_lights", text.replace("MAX_SOURCES", &sources))
}

/// The shader that plans which basis images are summed.
#[must_use]
pub fn planning() -> (&'static str, String) {
    let text = [NORMAL, SUM_PLANES, include_str!("shaders/planes_plan.wgsl")].join("\n");
    ("planes_plan", text.replace("BY_NORMAL", &by_normal()))
}

/// The shader that sums basis images.
#[must_use]
pub fn summing(of: Summing) -> (&'static str, String) {
    let text = [NORMAL, SUM_PLANES, include_str!("shaders/planes_sum.wgsl")].join("\n");
    let text = text
        .replace("REAL", &of.real.to_string())
        .replace("BY_NORMAL", &by_normal())
        .replace("LIGHTS", &format!("{}u", of.lights))
        .replace("ACROSS", &format!("{}u", of.across))
        .replace("SIDE", &format!("{}u", of.side));
    ("planes_sum", text)
}

/// Texels along a side of the table of Asum by normal; odd, so that the axes fall on texels.
pub const BY_NORMAL: u32 = 65;

fn by_normal() -> String {
    format!("{BY_NORMAL}u")
}

/// The properties for which the text of `planes_sum` is made.
#[derive(Clone, Copy, Debug)]
pub struct Summing {
    /// Whether the planes are of the real layer, otherwise of the virtual layer.
    pub real: bool,
    /// Maximum number of lights.
    pub lights: u32,
    /// Images in a row of the texture that holds them.
    pub across: u32,
    /// Texels along a side of an image.
    pub side: u32,
}

const IMAGE_FLAGS: &str = include_str!("shaders/lib/image_flags.wgsl");
const SUM_PLANES: &str = include_str!("shaders/lib/sum_planes.wgsl");

/// The shader of a frame named `name`.
pub fn shader(name: &str, variant: Variant) -> Shader {
    let parts = FRAME_SHADERS.iter().find(|(n, _)| *n == name);
    let text = parts.map(|(_, parts)| for_variant(join(parts), variant));
    Shader {
        label: name.to_owned(),
        text: text.unwrap_or_default(),
    }
}

/// The baking shader named `name`.
pub fn bake_shader(name: &str, resolution: u32) -> Shader {
    named(name, baking(resolution))
}

/// A shader from its name and text.
pub fn one((name, text): (&'static str, String)) -> Shader {
    named(name, [(name, text)])
}

fn named<const N: usize>(name: &str, shaders: [(&'static str, String); N]) -> Shader {
    let text = shaders.into_iter().find(|(n, _)| *n == name);
    Shader {
        label: name.to_owned(),
        text: text.map(|(_, text)| text).unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {

    #[test]
    fn every_shader_is_valid_wgsl() {
        let variants = [
            (1, 1, false, false),
            (4, 1, true, true),
            (4, 8, true, false),
            (4, 8, true, true),
            (4, 2, false, true),
        ];
        for (samples, soft, lamps, cached) in variants {
            let variant = super::Variant {
                samples,
                soft,
                lamps,
                areas: soft > 1,
                phong: samples > 1,
                cached,
                exposed: lamps,
                rolling_shutter: samples > 1,
                vignetting: samples > 1,
                nearby: soft > 1,
            };
            let frame =
                super::FRAME_SHADERS.map(|(name, _)| (name, super::shader(name, variant).text));
            let summing = [true, false];
            let planes = summing.map(|real| {
                super::summing(super::Summing {
                    real,
                    lights: 40,
                    across: 64,
                    side: 128,
                })
            });
            let planes = planes
                .into_iter()
                .chain([super::planning(), super::lighting()]);
            let exposing = super::exposing(&crate::exposure::region::constants());
            let all = frame.into_iter().chain(super::baking(128)).chain(planes);
            let look = super::look(super::LookVariant {
                samples,
                distorted: lamps,
                exposed: soft > 1,
                spread: lamps,
                grain: lamps,
                taps: 8,
            });
            let all = all.chain(exposing).chain(look);
            for (name, text) in all {
                let module = naga::front::wgsl::parse_str(&text)
                    .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
                naga::valid::Validator::new(
                    naga::valid::ValidationFlags::all(),
                    naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32,
                )
                .validate(&module)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
            }
        }
    }
}
