//! Checks the Vulkan driver, the adapters with the features and limits that Penumbra needs, and the
//! shaders.

use super::{Check, DoctorOptions, State};
use penumbra_camera::Response;
use penumbra_compositor::{Compositor, CompositorSettings, Gpu, GpuError};
use std::path::{Path, PathBuf};

const INSTALL_SOFTWARE: &str =
    "sudo apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers";

/// A required limit of the adapter.
struct Need {
    what: &'static str,
    min: u32,
    of: fn(&wgpu::Limits) -> u32,
}

/// The shadow maps of all dome lights are one texture array; pictures may be 4K wide.
const NEEDS: [Need; 5] = [
    Need {
        what: "texture side",
        min: 4096,
        of: |l| l.max_texture_dimension_2d,
    },
    Need {
        what: "texture array layers",
        min: 256,
        of: |l| l.max_texture_array_layers,
    },
    Need {
        what: "storage buffers a stage",
        min: 4,
        of: |l| l.max_storage_buffers_per_shader_stage,
    },
    Need {
        what: "sampled textures a stage",
        min: 16,
        of: |l| l.max_sampled_textures_per_shader_stage,
    },
    Need {
        what: "colour attachments",
        min: 4,
        of: |l| l.max_color_attachments,
    },
];

pub(super) fn examine(options: &DoctorOptions) -> Vec<Check> {
    let mut checks = vec![drivers(&options.root)];
    match Gpu::open(options.adapter.as_deref()) {
        Ok(gpu) => {
            checks.push(adapter(&gpu, &options.root));
            let limits = limits(&gpu.device.limits());
            let fit = limits.state == State::Ok;
            checks.extend([limits, timestamps(&gpu)]);
            // Compiling beyond the limits would end in the driver's own error.
            if fit {
                checks.push(shaders(gpu));
            }
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

fn limits(limits: &wgpu::Limits) -> Check {
    let short: Vec<String> = NEEDS
        .iter()
        .filter(|need| (need.of)(limits) < need.min)
        .map(|need| {
            let has = (need.of)(limits);
            format!("{} {has} of {}", need.what, need.min)
        })
        .collect();
    if short.is_empty() {
        let all = NEEDS.map(|need| format!("{} {}", need.what, (need.of)(limits)));
        Check::ok("adapter limits", all.join(", "))
    } else {
        Check::fail(
            "adapter limits",
            format!("too small: {}", short.join(", ")),
            "update the graphics driver, or choose another adapter with --adapter",
        )
    }
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
    fn fails_for_a_missing_named_driver() {
        let gone = named_drivers(vec![PathBuf::from("/no/such.json")]);
        assert_eq!(gone.state, State::Fail);
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        assert_eq!(named_drivers(vec![manifest]).state, State::Ok);
    }

    #[test]
    fn names_the_limit_that_an_adapter_does_not_meet() {
        let enough = wgpu::Limits::default();
        assert_eq!(limits(&enough).state, State::Ok);
        let small = wgpu::Limits {
            max_texture_array_layers: 128,
            ..enough
        };
        let check = limits(&small);
        assert_eq!(check.state, State::Fail);
        assert!(check.found.contains("texture array layers 128 of 256"));
    }
}
