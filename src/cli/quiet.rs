//! Silences a library of the graphics driver.

/// Switches off Mesa's device-select layer where there is no desktop. The layer asks Wayland for the
/// desktop's adapter and, without a desktop, prints an error about XDG_RUNTIME_DIR per adapter. The
/// variable that switches it off must be set when the program starts; so the program replaces its
/// own process with the variable set. With a desktop the layer stays, because users may choose an
/// adapter through it.
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
    // Returns only on failure. Then the errors are printed, without further harm.
    let _ = std::process::Command::new(program)
        .arg0(name)
        .args(arguments)
        .env(OFF, "1")
        .exec();
}

/// Does nothing: only Linux has that layer.
#[cfg(not(target_os = "linux"))]
pub const fn silence_device_select() {}
