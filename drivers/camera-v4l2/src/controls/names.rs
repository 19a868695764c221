//! Names of controls, as `v4l2-ctl` prints them, and what their names imply.

/// The name that `v4l2-ctl` derives from a driver's title: `White Balance, Automatic` becomes
/// `white_balance_automatic` (v4l-utils, `name2var`).
pub(crate) fn from_title(title: &str) -> String {
    let mut name = String::with_capacity(title.len());
    let mut after_gap = false;
    for letter in title.chars() {
        if letter.is_ascii_alphanumeric() {
            if after_gap && !name.is_empty() {
                name.push('_');
            }
            name.push(letter.to_ascii_lowercase());
            after_gap = false;
        } else {
            after_gap = true;
        }
    }
    name
}

/// Names before Linux 5.14, and the present ones.
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

/// The present name of a control that is given by its present or its former name.
pub(crate) fn present_name(name: &str) -> &str {
    let renamed = RENAMED.iter().find(|(former, _)| *former == name);
    renamed.map_or(name, |(_, present)| present)
}

/// The order in which controls are set, lowest first: an automatic mode before the controls
/// that it governs, because writing these fails (`uvcvideo`: EACCES) or has no effect.
pub(crate) fn set_order(name: &str) -> u8 {
    match present_name(name) {
        "auto_exposure" => 0,
        name if name.contains("auto") => 1,
        "exposure_dynamic_framerate" | "power_line_frequency" => 2,
        _ => 3,
    }
}

/// The automatic modes that may govern a control, most likely first, each with the value that
/// makes the control manual.
pub(crate) fn automatic_modes(name: &str) -> &'static [(&'static str, i64)] {
    match present_name(name) {
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
            assert_eq!(from_title(title), name);
        }
    }

    #[test]
    fn former_names_are_understood() {
        assert_eq!(present_name("exposure_absolute"), "exposure_time_absolute");
        assert_eq!(present_name("gain"), "gain");
        let is_final = |name: &str| present_name(name) == name;
        assert!(RENAMED.iter().all(|(_, present)| is_final(present)));
    }

    #[test]
    fn automatic_modes_are_set_before_the_controls_that_they_govern() {
        for name in [
            "exposure_time_absolute",
            "gain",
            "white_balance_temperature",
            "hue",
        ] {
            for (mode, _) in automatic_modes(name) {
                assert!(set_order(mode) < set_order(name), "{mode} before {name}");
            }
        }
        assert!(set_order("exposure_auto") < set_order("exposure_absolute"));
    }
}
