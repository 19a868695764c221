//! Checks the Vulkan driver, the adapters with the features and limits that Penumbra needs, and the
//! shaders.

use super::{Check, DoctorOptions};
use penumbra_camera::Response;
use penumbra_compositor::{Compositor, CompositorSettings, Gpu, GpuError};
use std::path::{Path, PathBuf};

const INSTALL_SOFTWARE: &str =
    "sudo apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers";

pub(super) fn examine(options: &DoctorOptions) -> Vec<Check> {
    let mut checks = vec![drivers(&options.root)];
    match Gpu::open(options.adapter.as_deref()) {
        Ok(gpu) => {
            checks.push(adapter(&gpu, &options.root));
            if gpu.software {
                checks.push(processor(&processor_extensions()));
            }
            checks.extend([limits(&gpu.device.limits()), timestamps(&gpu)]);
            checks.push(shaders(gpu));
        }
        Err(error) => checks.push(no_adapter(&error)),
    }
    checks
}

/// The manifests through which the Vulkan loader finds drivers.
fn drivers(root: &Path) -> Check {
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .find_map(std::env::var_os);
    if let Some(paths) = named {
        return named_drivers(std::env::split_paths(&paths).collect());
    }
    let found = manifests(root);
    if found.is_empty() {
        Check::fail(
            "Vulkan drivers",
            "none installed: no manifest in /usr/share/vulkan/icd.d or /etc/vulkan/icd.d",
            format!("{INSTALL_SOFTWARE} (software), or your graphics card's driver"),
        )
    } else {
        Check::ok("Vulkan drivers", found.join(", "))
    }
}

/// VK_DRIVER_FILES replaces what is installed, so a missing file in it hides all drivers.
fn named_drivers(paths: Vec<PathBuf>) -> Check {
    let shown: Vec<String> = paths.iter().map(|p| p.display().to_string()).collect();
    let shown = shown.join(", ");
    if paths.iter().any(|path| path.exists()) {
        return Check::ok("Vulkan drivers", shown);
    }
    Check::fail(
        "Vulkan drivers",
        format!("VK_DRIVER_FILES names {shown}, which does not exist"),
        "unset VK_DRIVER_FILES VK_ICD_FILENAMES",
    )
}

fn manifests(root: &Path) -> Vec<String> {
    let folders = ["usr/share/vulkan/icd.d", "etc/vulkan/icd.d"].map(|f| root.join(f));
    let mut names: Vec<String> = folders
        .iter()
        .filter_map(|folder| std::fs::read_dir(folder).ok())
        .flatten()
        .filter_map(|entry| entry.ok().map(|e| PathBuf::from(e.file_name())))
        .filter(|name| name.extension().is_some_and(|e| e == "json"))
        .filter_map(|name| Some(name.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    names
}

fn no_adapter(error: &GpuError) -> Check {
    let remedy = match error {
        GpuError::NoAdapter => INSTALL_SOFTWARE,
        GpuError::NotFound { .. } => "leave --adapter out, or give a name from that list",
        GpuError::Unfit { .. } | GpuError::Failed { .. } | GpuError::Stopped => {
            "update the graphics driver, or choose another adapter with --adapter"
        }
    };
    Check::fail("adapter", error.to_string(), remedy)
}

fn adapter(gpu: &Gpu, root: &Path) -> Check {
    let info = gpu.adapter.get_info();
    let found = format!(
        "{} ({:?}, {:?}, driver {} {})",
        info.name, info.device_type, info.backend, info.driver, info.driver_info
    );
    if !gpu.software {
        return Check::ok("adapter", found);
    }
    let card = root.join("dev/dri").is_dir();
    let remedy = if card {
        "install the graphics card's Vulkan driver and join the group `render` (below)"
    } else {
        "none needed without a graphics card; with one, install its Vulkan driver"
    };
    Check::warn(
        "adapter",
        format!("{found}: a software driver, which is slower than any GPU"),
        remedy,
    )
}

/// The extensions for which the software driver compiles shaders, and whether the processor has
/// them, those that matter most first.
fn processor_extensions() -> Vec<(&'static str, bool)> {
    #[cfg(target_arch = "x86_64")]
    return vec![
        ("F16C", is_x86_feature_detected!("f16c")),
        ("AVX2", is_x86_feature_detected!("avx2")),
        ("FMA", is_x86_feature_detected!("fma")),
        ("AVX-512", is_x86_feature_detected!("avx512vl")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    Vec::new()
}

fn processor(extensions: &[(&str, bool)]) -> Check {
    let named = |wanted: bool| {
        let names = extensions.iter().filter(|(_, has)| *has == wanted);
        names.map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
    };
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let found = format!("{threads} threads; has {}", named(true));
    match named(false).as_str() {
        "" => Check::ok("processor", found),
        // Most processors lack it.
        "AVX-512" => Check::ok(
            "processor",
            format!("{found}; with AVX-512 virtual objects would be drawn faster"),
        ),
        lacking => Check::warn(
            "processor",
            format!("{found}; lacks {lacking}, so the software driver is slow or cannot run"),
            "in a virtual machine, pass on the host's processor (QEMU: -cpu host)",
        ),
    }
}

/// Shows the limits of an adapter that has all required ones; [`Gpu::open`] refuses others.
fn limits(limits: &wgpu::Limits) -> Check {
    let wgpu::Limits {
        max_texture_dimension_2d: side,
        max_texture_array_layers: layers,
        max_storage_buffers_per_shader_stage: buffers,
        max_sampled_textures_per_shader_stage: textures,
        ..
    } = limits;
    Check::ok(
        "adapter limits",
        format!(
            "textures of {side}² texels and {layers} layers; {buffers} storage buffers and \
             {textures} textures a stage"
        ),
    )
}

fn timestamps(gpu: &Gpu) -> Check {
    if gpu.timestamps {
        Check::ok("GPU times", "passes can be timed on the device")
    } else {
        Check::warn(
            "GPU times",
            "the adapter has no time stamps, so status and bench show no GPU times",
            "none needed for the picture; another adapter (--adapter) may have them",
        )
    }
}

/// Creates every pipeline, because some drivers refuse a shader only then.
fn shaders(gpu: Gpu) -> Check {
    let device = gpu.device.clone();
    let settings = CompositorSettings::for_adapter(gpu.software);
    let invalid = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let exhausted = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let compositor = Compositor::new(gpu, settings, Response::srgb());
    let error = pollster::block_on(exhausted.pop()).or(pollster::block_on(invalid.pop()));
    drop(compositor);
    match error {
        None => Check::ok("shaders", "all compile on this adapter"),
        Some(error) => Check::fail(
            "shaders",
            first_words(&error.to_string()),
            "update the graphics driver, or choose another adapter with --adapter",
        ),
    }
}

/// Returns one line of a message of a driver or compiler.
fn first_words(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().take(24).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::State;

    #[test]
    fn finds_driver_manifests_in_both_folders() {
        let root = tempfile::tempdir().unwrap();
        for (folder, name) in [
            ("usr/share/vulkan/icd.d", "lvp.json"),
            ("etc/vulkan/icd.d", "card.json"),
            ("etc/vulkan/icd.d", "README"),
        ] {
            let folder = root.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(name), "{}").unwrap();
        }
        assert_eq!(manifests(root.path()), ["card", "lvp"]);
        assert!(manifests(&root.path().join("nowhere")).is_empty());
    }

    #[test]
    fn names_what_the_processor_lacks() {
        let with = |has: [bool; 4]| {
            let names = ["F16C", "AVX2", "FMA", "AVX-512"];
            processor(&std::array::from_fn::<_, 4, _>(|i| (names[i], has[i])))
        };
        assert_eq!(with([true; 4]).state, State::Ok);
        let common = with([true, true, true, false]);
        assert_eq!(common.state, State::Ok);
        assert!(common.found.contains("has F16C, AVX2, FMA; with AVX-512"));
        let old = with([false, false, true, false]);
        assert_eq!(old.state, State::Warn);
        assert!(old.found.contains("lacks F16C, AVX2, AVX-512"), "{old:?}");
    }

    #[test]
    fn fails_for_a_missing_named_driver() {
        let gone = named_drivers(vec![PathBuf::from("/no/such.json")]);
        assert_eq!(gone.state, State::Fail);
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        assert_eq!(named_drivers(vec![manifest]).state, State::Ok);
    }
}
