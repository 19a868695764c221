//! Names of controls: as `v4l2-ctl` spells them, old and new.

/// What `v4l2-ctl` makes of a driver's title: `White Balance, Automatic` is
/// `white_balance_automatic` (v4l-utils, `name2var`).
pub(crate) fn of_title(title: &str) -> String {
    let mut name = String::with_capacity(title.len());
    let mut gap = false;
    for letter in title.chars() {
        if letter.is_ascii_alphanumeric() {
            if gap && !name.is_empty() {
                name.push('_');
            }
            name.push(letter.to_ascii_lowercase());
            gap = false;
        } else {
            gap = true;
        }
    }
    name
}

/// Kernels before 5.14 called UVC's controls otherwise.
const RENAMED: [(&str, &str); 9] = [
    ("exposure_auto", "auto_exposure"),
    ("exposure_absolute", "exposure_time_absolute"),
    ("exposure_auto_priority", "exposure_dynamic_framerate"),
    ("white_balance_temperature_auto", "white_balance_automatic"),
    (
        "white_balance_component_auto",
        "white_balance_component_automatic",
    ),
    ("focus_auto", "focus_automatic_continuous"),
    ("hue_auto", "hue_automatic"),
    ("autogain", "gain_automatic"),
    ("brightness_auto", "brightness_automatic"),
];

/// The present name for an old or a present one.
pub(crate) fn canonical(name: &str) -> &str {
    let old = RENAMED.iter().find(|(old, _)| *old == name);
    old.map_or(name, |(_, new)| new)
}

/// In which order controls are set: modes before what they own, because a value that an
/// automatic mode owns is refused (uvcvideo: EACCES) or ignored.
pub(crate) fn rank(name: &str) -> u8 {
    match canonical(name) {
        "auto_exposure" => 0,
        name if name.contains("auto") => 1,
        "exposure_dynamic_framerate" | "power_line_frequency" => 2,
        _ => 3,
    }
}

/// The automatic modes that may own a control, the likeliest first, with the value that
/// ends their ownership.
pub(crate) fn owners(name: &str) -> &'static [(&'static str, i64)] {
    match canonical(name) {
        "exposure_time_absolute" | "exposure" | "iris_absolute" => &[("auto_exposure", 1)],
        "gain" => &[("gain_automatic", 0), ("auto_exposure", 1)],
        "white_balance_temperature" | "red_balance" | "blue_balance" => {
            &[("white_balance_automatic", 0)]
        }
        "focus_absolute" => &[("focus_automatic_continuous", 0)],
        "hue" => &[("hue_automatic", 0)],
        "brightness" => &[("brightness_automatic", 0)],
        _ => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn titles_become_the_names_of_v4l2_ctl() {
        for (title, name) in [
            ("Exposure Time, Absolute", "exposure_time_absolute"),
            ("White Balance, Automatic", "white_balance_automatic"),
            ("Gain, Automatic", "gain_automatic"),
            ("Focus, Automatic Continuous", "focus_automatic_continuous"),
            ("  LED1 Mode ", "led1_mode"),
            ("Exposure (Absolute)", "exposure_absolute"),
        ] {
            assert_eq!(of_title(title), name);
        }
    }

    #[test]
    fn old_names_are_understood() {
        assert_eq!(canonical("exposure_absolute"), "exposure_time_absolute");
        assert_eq!(canonical("gain"), "gain");
        assert!(RENAMED.iter().all(|(_, new)| canonical(new) == *new));
    }

    #[test]
    fn modes_come_before_what_they_own() {
        for name in [
            "exposure_time_absolute",
            "gain",
            "white_balance_temperature",
            "hue",
        ] {
            for (owner, _) in owners(name) {
                assert!(rank(owner) < rank(name), "{owner} before {name}");
            }
        }
        assert!(rank("exposure_auto") < rank("exposure_absolute"));
    }
}
