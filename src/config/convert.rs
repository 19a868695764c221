//! Conversion of the configuration file to [`Config`], with checks of ranges.

use super::devices;
use super::exposure::exposure;
use super::file::{self, ConfigFile};
use super::look::look;
use super::planes::planes;
use super::range::{Result, millis, power_of_two, set, whole, within};
use super::registration::{dictionaries, registration};
use super::renamed::renamed;
use super::{
    Config, EnvironmentConfig, EnvironmentMapConfig, OutputConfig, RoomLight, SceneFilesConfig,
    ShadowConfig, StatusConfig, SyncConfig, WhiteBalanceConfig, WhiteBalanceMethod,
};
use glam::DVec3;
use penumbra_rig_model::EnvironmentSource;
use penumbra_scene::SceneChoice;
use penumbra_strict_toml::TomlError;
use penumbra_strict_toml::{Fault, TomlText};
use std::net::SocketAddr;
use std::path::Path;

/// Supported numbers of dome lights.
pub const LIGHT_COUNTS: [u32; 7] = [0, 8, 24, 48, 64, 96, 384];

pub(super) fn config(text: &TomlText, folder: &Path) -> std::result::Result<Config, TomlError> {
    if let Some(fault) = renamed(text) {
        return Err(text.locate(fault));
    }
    let file: ConfigFile = text.parse()?;
    convert(file, folder).map_err(|fault| text.locate(fault))
}

fn convert(file: ConfigFile, folder: &Path) -> Result<Config> {
    let mut config = Config {
        scene: scene(&file.scene, folder)?,
        ..Config::default()
    };
    scene_files(file.scene, folder, &mut config.scene_files)?;
    config.scene_camera.response = file.scene_camera.response;
    let scene_camera = devices::camera("scene_camera", file.scene_camera.camera(), folder)?;
    set(&mut config.scene_camera.source, scene_camera);
    config.environment_camera =
        devices::camera("environment_camera", file.environment_camera, folder)?;
    config.tracker = devices::tracker(file.tracker, folder)?;
    config.calibration = file.calibration.from.map(|path| folder.join(path));
    devices::recording(file.recording, folder, &mut config.recording)?;
    environment(file.environment, folder, &mut config.environment)?;
    config.environment.room_lights = room_lights(&file.room_light)?;
    registration(&file.registration, &mut config.registration)?;
    config.dictionaries = dictionaries(&file.registration.dictionaries, folder)?;
    white_balance(&file.white_balance, &mut config.white_balance)?;
    shadows(&file.shadows, &mut config.shadows)?;
    set(&mut config.shading.reflections, file.shading.reflections);
    set(
        &mut config.shading.indirect_light,
        file.shading.indirect_light,
    );
    set(
        &mut config.shading.lamp_response,
        file.shading.lamp_response,
    );
    planes(file.planes, folder, &mut config.planes)?;
    exposure(&file.exposure, &mut config.exposure)?;
    set(&mut config.picture.quality, file.picture.quality);
    set(&mut config.picture.antialias, file.picture.antialias);
    look(&file.look, &mut config.look)?;
    sync(&file.sync, &mut config.sync)?;
    set(&mut config.input.yuv_matrix, file.input.yuv_matrix);
    set(&mut config.input.yuv_range, file.input.yuv_range);
    output(file.output, folder, &mut config.output)?;
    config.status.guide = file.status.guide.as_ref().map(|path| folder.join(path));
    status(file.status, &mut config.status)?;
    config.gpu.adapter = file.gpu.adapter.filter(|name| name != "auto");
    set(&mut config.replay.speed, file.replay.speed);
    set(&mut config.replay.repeat, file.replay.repeat);
    set(&mut config.replay.pairing, file.replay.pairing);
    Ok(config)
}

fn scene(file: &file::Scene, folder: &Path) -> Result<SceneChoice> {
    let Some(text) = &file.file else {
        return Ok(SceneChoice::Session);
    };
    let choice = SceneChoice::from_text(text);
    let SceneChoice::File(path) = choice else {
        return Ok(choice);
    };
    let path = folder.join(path);
    if !path.is_file() {
        return Err(Fault::new(
            "scene.file",
            format!(
                "there is no file {}; expected a scene file, \"session\" or \"none\"",
                path.display()
            ),
        ));
    }
    Ok(SceneChoice::File(path))
}

fn scene_files(file: file::Scene, folder: &Path, out: &mut SceneFilesConfig) -> Result<()> {
    out.folder = file.folder.map(|path| folder.join(path));
    let upload = within("scene.max_upload_mb", file.max_upload_mb, 0.0..=1000.0)?;
    set(
        &mut out.max_upload_bytes,
        upload.map(|mb| (mb * 1e6) as u64),
    );
    Ok(())
}

fn environment(file: file::Environment, folder: &Path, out: &mut EnvironmentConfig) -> Result<()> {
    set(&mut out.source, file.source);
    out.map = environment_map(&file, folder)?;
    out.response = file.response;
    if let Some(list) = file.brackets_ev {
        if list.len() > 16 || list.iter().any(|ev| !(-30.0..=30.0).contains(ev)) {
            return Err(Fault::new(
                "environment.brackets_ev",
                "expected at most 16 stops between -30 and 30",
            ));
        }
        out.brackets_ev = Some(list);
    }
    set(
        &mut out.cube_size,
        power_of_two("environment.cube_size", file.cube_size, 16, 512)?,
    );
    set(&mut out.light_placement, file.light_placement);
    if let Some(count) = file.light_count {
        if !LIGHT_COUNTS.contains(&count) {
            return Err(Fault::new(
                "environment.light_count",
                format!("expected one of {LIGHT_COUNTS:?}, found {count}"),
            ));
        }
        out.light_count = count;
    }
    set(&mut out.clipped, file.clipped);
    set(&mut out.irradiance, file.irradiance);
    set(&mut out.unseen, file.unseen);
    let stale = millis(
        "environment.stale_after_ms",
        file.stale_after_ms,
        1.0..=60_000.0,
    )?;
    set(&mut out.stale_after_nanos, stale);
    set(&mut out.light_places, file.light_places);
    Ok(())
}

fn environment_map(
    file: &file::Environment,
    folder: &Path,
) -> Result<Option<EnvironmentMapConfig>> {
    let yaw = within("environment.map_yaw_deg", file.map_yaw_deg, -360.0..=360.0)?;
    let stops = within("environment.map_ev", file.map_ev, -30.0..=30.0)?;
    let map = file.map.as_ref().map(|path| EnvironmentMapConfig {
        path: folder.join(path),
        yaw: yaw.unwrap_or(0.0).to_radians() as f32,
        factor: stops.unwrap_or(0.0).exp2() as f32,
    });
    if map.is_none() && file.source == Some(EnvironmentSource::Map) {
        return Err(Fault::new(
            "environment.source",
            "\"map\" needs `map`; add the path of an environment map (.hdr, .exr)",
        ));
    }
    Ok(map)
}

/// Maximum number of stated lights.
const MAX_ROOM_LIGHTS: usize = 16;
/// Maximum distance of a stated light from the world's origin along an axis, metres.
const ROOM: f64 = 1000.0;
/// Least side of a window, metres.
const LEAST_SIDE: f64 = 0.01;
/// Distance of the corners from those of a parallelogram, and least height of it, as shares of the shorter side.
const SHAPE: (f64, f64) = (0.1, 0.3);

fn room_lights(file: &[file::RoomLight]) -> Result<Vec<RoomLight>> {
    if file.len() > MAX_ROOM_LIGHTS {
        return Err(Fault::new(
            "room_light",
            format!(
                "expected at most {MAX_ROOM_LIGHTS} lights, found {}",
                file.len()
            ),
        ));
    }
    let light = |(i, light): (usize, &file::RoomLight)| {
        let name = |key: &str| format!("room_light[{i}].{key}");
        match (light.position, light.corners) {
            (Some(position), None) => {
                in_room(name("position"), &position)?;
                Ok(RoomLight::Lamp { position })
            }
            (None, Some(corners)) => {
                in_room(name("corners"), corners.as_flattened())?;
                if !is_window(&corners) {
                    return Err(Fault::new(
                        name("corners"),
                        "expected the four corners of a rectangle, one after the other along its edge",
                    ));
                }
                Ok(RoomLight::Window { corners })
            }
            _ => Err(Fault::new(
                format!("room_light[{i}]"),
                "expected either `position` (of a lamp) or `corners` (of a window)",
            )),
        }
    };
    file.iter().enumerate().map(light).collect()
}

fn in_room(name: String, metres: &[f64]) -> Result<()> {
    if metres.iter().all(|x| x.abs() <= ROOM) {
        return Ok(());
    }
    Err(Fault::new(
        name,
        format!("expected metres from -{ROOM} to {ROOM}, found {metres:?}"),
    ))
}

/// Whether these are the corners of a parallelogram, as far as a tape measure tells.
fn is_window(corners: &[[f64; 3]; 4]) -> bool {
    let [a, b, c, d] = corners.map(DVec3::from);
    let (right, up) = (b - a, d - a);
    let side = right.length().min(up.length());
    let slant = right.cross(up).length() / right.length().max(up.length());
    side > LEAST_SIDE && slant > SHAPE.1 * side && (b + up).distance(c) < SHAPE.0 * side
}

fn white_balance(file: &file::WhiteBalance, out: &mut WhiteBalanceConfig) -> Result<()> {
    set(&mut out.method, file.method);
    set(&mut out.matrix, file.matrix);
    out.same_camera = file.same_camera;
    if let Some(gains) = file.gains {
        if gains.iter().any(|g| !(0.01..=100.0).contains(g)) {
            return Err(Fault::new(
                "white_balance.gains",
                "expected three linear gains between 0.01 and 100: red, green, blue",
            ));
        }
        out.gains = gains.map(|g| g as f32);
    } else if out.method == WhiteBalanceMethod::Fixed {
        return Err(Fault::new(
            "white_balance.method",
            "\"fixed\" needs `gains`; add three linear gains: red, green, blue",
        ));
    }
    Ok(())
}

fn shadows(file: &file::Shadows, out: &mut ShadowConfig) -> Result<()> {
    set(&mut out.technique, file.technique);
    set(&mut out.mode, file.mode);
    let strength = within("shadows.strength", file.strength, 0.0..=1.0)?;
    set(&mut out.strength, strength.map(|s| s as f32));
    set(
        &mut out.map_size,
        power_of_two("shadows.map_size", file.map_size, 64, 4096)?,
    );
    set(&mut out.refresh_per_frame, file.refresh_per_frame);
    set(&mut out.soft, file.soft);
    Ok(())
}

fn sync(file: &file::Sync, out: &mut SyncConfig) -> Result<()> {
    let latency = -1000.0..=1000.0;
    out.scene_camera_latency_nanos = millis(
        "sync.scene_camera_latency_ms",
        file.scene_camera_latency_ms,
        latency.clone(),
    )?;
    out.environment_camera_latency_nanos = millis(
        "sync.environment_camera_latency_ms",
        file.environment_camera_latency_ms,
        latency.clone(),
    )?;
    out.tracker_latency_nanos =
        millis("sync.tracker_latency_ms", file.tracker_latency_ms, latency)?;
    set(&mut out.follow_latency, file.follow_latency);
    let smoothing = millis(
        "sync.pose_smoothing_ms",
        file.pose_smoothing_ms,
        0.0..=1000.0,
    )?;
    set(&mut out.pose_smoothing_nanos, smoothing);
    let max_prediction = millis(
        "sync.max_prediction_ms",
        file.max_prediction_ms,
        0.0..=1000.0,
    )?;
    set(&mut out.max_prediction_nanos, max_prediction);
    let wait = millis("sync.max_wait_ms", file.max_wait_ms, 0.0..=1000.0)?;
    set(&mut out.max_wait_nanos, wait);
    Ok(())
}

fn output(file: file::Output, folder: &Path, out: &mut OutputConfig) -> Result<()> {
    set(&mut out.window, file.window);
    out.monitor = file.monitor;
    set(&mut out.fullscreen, file.fullscreen);
    out.frames = file.frames.map(|path| folder.join(path));
    out.freed = file.freed.map(|text| freed_receiver(&text)).transpose()?;
    Ok(())
}

fn freed_receiver(text: &str) -> Result<SocketAddr> {
    text.parse().map_err(|_| {
        let reason =
            format!("expected an address and a port such as 127.0.0.1:40000, found {text:?}");
        Fault::new("output.freed", reason)
    })
}

fn status(file: file::Status, out: &mut StatusConfig) -> Result<()> {
    if let Some(listen) = &file.listen {
        out.listen = listen.parse().map_err(|_| {
            Fault::new(
                "status.listen",
                format!(
                    "expected an address and a port such as \"127.0.0.1:8780\", found \"{listen}\""
                ),
            )
        })?;
    }
    if let Some(token) = file.token {
        if !crate::token::is_token(&token) {
            return Err(Fault::new(
                "status.token",
                "expected 12 to 256 letters, digits or -._~",
            ));
        }
        out.token = Some(token);
    }
    if listen_needs_token(out.listen, out.token.as_deref()) {
        return Err(Fault::new(
            "status.listen",
            format!(
                "{} can be reached from other machines; set `token`, or listen on 127.0.0.1",
                out.listen
            ),
        ));
    }
    let quality = whole("status.stream_quality", file.stream_quality, 1..=100)?;
    set(&mut out.stream_quality, quality.map(|q| q as u8));
    set(
        &mut out.viewers,
        whole("status.viewers", file.viewers, 1..=4096)?,
    );
    let rate = whole(
        "status.stream_mbit_per_s",
        file.stream_mbit_per_s,
        1..=100_000,
    )?;
    set(&mut out.stream_mbit_per_s, rate);
    Ok(())
}

/// Whether an address can be reached from other machines and no token is set.
#[must_use]
pub fn listen_needs_token(listen: SocketAddr, token: Option<&str>) -> bool {
    !listen.ip().is_loopback() && token.is_none_or(str::is_empty)
}

/// Lists the settings in a file that differ from `config/rig.toml`.
pub(super) fn changed_keys(text: &TomlText) -> std::result::Result<Vec<String>, TomlError> {
    let defaults: toml::Table = TomlText::new("rig.toml", DEFAULTS).parse()?;
    let given: toml::Table = text.parse()?;
    let mut out = Vec::new();
    for (section, keys) in &given {
        if let Some(list) = keys.as_array() {
            let each = list.iter();
            out.extend(each.map(|entry| format!("[[{section}]] {}", one_line(entry))));
        }
        for (key, value) in keys.as_table().into_iter().flatten() {
            let default = defaults.get(section).and_then(|s| s.get(key));
            if default != Some(value) {
                let shown = if key == "token" {
                    "(set)".to_owned()
                } else {
                    value.to_string()
                };
                out.push(format!("{section}.{key} = {shown}"));
            }
        }
    }
    Ok(out)
}

/// Returns all settings with the values in effect: those of the file, else the documented defaults.
pub(super) fn effective(text: &TomlText) -> std::result::Result<toml::Table, TomlError> {
    let mut all: toml::Table = TomlText::new("rig.toml", DEFAULTS).parse()?;
    overlay(&mut all, text.parse()?);
    let token = all.get_mut("status").and_then(|s| s.get_mut("token"));
    if let Some(token) = token {
        *token = toml::Value::String("(set)".to_owned());
    }
    Ok(all)
}

/// Returns the default of a setting, `section.key`, as it would be written on a command line; `None` if it
/// has none.
#[must_use]
pub fn default_value(setting: &str) -> Option<String> {
    let all: toml::Table = TomlText::new("rig.toml", DEFAULTS).parse().ok()?;
    let (section, key) = setting.split_once('.')?;
    match all.get(section)?.get(key)? {
        toml::Value::String(text) => Some(text.clone()),
        value => Some(value.to_string()),
    }
}

/// Replaces the values of `all` by those given.
fn overlay(all: &mut toml::Table, given: toml::Table) {
    for (key, value) in given {
        match (all.get_mut(&key), value) {
            (Some(toml::Value::Table(known)), toml::Value::Table(given)) => overlay(known, given),
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
}

/// The keys of a table in one line.
fn one_line(table: &toml::Value) -> String {
    let keys = table.as_table().into_iter().flatten();
    let each: Vec<String> = keys
        .map(|(key, value)| format!("{key} = {value}"))
        .collect();
    each.join(", ")
}

/// The documented defaults, `config/rig.toml`.
pub(super) const DEFAULTS: &str = include_str!("../../config/rig.toml");
