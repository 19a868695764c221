//! Keeps a library of the graphics driver from talking to the user.

/// Mesa's device-select layer asks Wayland which adapter the desktop is on. Without a
/// desktop that ends in lines on standard error about XDG_RUNTIME_DIR, once per adapter,
/// between ours. A variable switches the layer off, but only one that is there from the
/// program's start; so the program starts itself again with it, as the same process.
/// Where a desktop is, the layer stays: the user may choose an adapter through it.
#[cfg(target_os = "linux")]
pub fn silence_device_select() {
    use std::os::unix::process::CommandExt;
    const OFF: &str = "NODEVICE_SELECT";
    let is_set = |name| std::env::var_os(name).is_some();
    if is_set(OFF) || is_set("XDG_RUNTIME_DIR") {
        return;
    }
    let mut arguments = std::env::args_os();
    let (Some(name), Ok(program)) = (arguments.next(), std::env::current_exe()) else {
        return;
    };
    // Comes back only if it failed. Then the lines are there, and nothing else is lost.
    let _ = std::process::Command::new(program)
        .arg0(name)
        .args(arguments)
        .env(OFF, "1")
        .exec();
}

/// Only Linux has that layer.
#[cfg(not(target_os = "linux"))]
pub const fn silence_device_select() {}
