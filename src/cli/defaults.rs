//! Defaults in the help of options that override the configuration: clap does not know them, because
//! without the option the configuration's value applies.

use clap::{Arg, Command};
use penumbra_config::default_value;

/// Options of `run` and `replay`, and their settings.
const SHOW: [(&str, &str); 14] = [
    ("scene", "scene.file"),
    ("listen", "status.listen"),
    ("adapter", "gpu.adapter"),
    ("quality", "picture.quality"),
    ("environment_source", "environment.source"),
    ("light_placement", "environment.light_placement"),
    ("light_count", "environment.light_count"),
    ("shadow_mode", "shadows.mode"),
    ("reflections", "shading.reflections"),
    ("lamp_response", "shading.lamp_response"),
    ("technique", "shadows.technique"),
    ("exposure", "exposure.mode"),
    ("highlights", "exposure.highlights"),
    ("monitor", "output.monitor"),
];
/// Options of `webcam`, and what the configuration has that it writes; the others are those of `run`.
const WEBCAM: [(&str, &str); 2] = [
    ("scene", "scene.toml in --folder"),
    ("environment_source", "sphere-in-scene"),
];
const REPLAY: [(&str, &str); 2] = [("speed", "replay.speed"), ("pairing", "replay.pairing")];
const BAKE: [(&str, &str); 6] = [
    ("planes", "planes.count"),
    ("frequency", "planes.frequency"),
    ("clusters", "planes.clusters"),
    ("resolution", "planes.resolution"),
    ("samples", "planes.samples"),
    ("adapter", "gpu.adapter"),
];
const BENCH: [(&str, &str); 1] = [("adapter", "gpu.adapter")];
const DOCTOR: [(&str, &str); 2] = [("listen", "status.listen"), ("adapter", "gpu.adapter")];
/// Of `record`, and of the steps of `calibrate` that can run live.
const LIVE: [(&str, &str); 1] = [("listen", "status.listen")];

/// Adds the defaults to the help of the commands.
pub fn add_to(program: Command) -> Command {
    // In place, so that the order of the options stays.
    let add = |program: Command, name: &str, options: &'static [(&str, &str)]| {
        program.mut_subcommand(name, |command| {
            command.mut_args(|arg| with_default(arg, options))
        })
    };
    let program = add(program, "run", &SHOW);
    let program = add(program, "replay", &SHOW);
    let program = add(program, "replay", &REPLAY);
    let program = add(program, "bake", &BAKE);
    let program = add(program, "bench", &BENCH);
    let program = add(program, "doctor", &DOCTOR);
    let program = program.mut_subcommand("webcam", webcam);
    let program = add(program, "record", &LIVE);
    program.mut_subcommand("calibrate", |calibrate| {
        let names: Vec<String> = (calibrate.get_subcommands())
            .map(|step| step.get_name().to_owned())
            .collect();
        let live = |step: Command| step.mut_args(|arg| with_default(arg, &LIVE));
        (names.iter()).fold(calibrate, |calibrate, name| {
            calibrate.mut_subcommand(name, live)
        })
    })
}

/// Adds the defaults of `webcam`, and hides an option that it has in common with `run` but refuses.
fn webcam(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let own = WEBCAM.iter().find(|(option, _)| arg.get_id() == option);
        match own {
            Some((_, default)) => stating(arg, default),
            None => with_default(arg, &SHOW),
        }
    });
    command.mut_arg("config", |arg| arg.hide(true))
}

fn with_default(arg: Arg, options: &[(&str, &str)]) -> Arg {
    let setting = options.iter().find(|(option, _)| arg.get_id() == option);
    match setting.and_then(|(_, setting)| default_value(setting)) {
        Some(default) => stating(arg, &default),
        None => arg,
    }
}

fn stating(arg: Arg, default: &str) -> Arg {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    arg.help(format!("{help} [default: {default}]"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_option_of_the_lists_shows_the_default_of_its_setting() {
        type Options = &'static [(&'static str, &'static str)];
        let mut program = crate::cli::command();
        program.build();
        let lists: [(&[&str], Options); 10] = [
            (&["run"], &SHOW),
            (&["webcam"], &SHOW[5..]),
            (&["replay"], &SHOW),
            (&["replay"], &REPLAY),
            (&["bake"], &BAKE),
            (&["bench"], &BENCH),
            (&["doctor"], &DOCTOR),
            (&["record"], &LIVE),
            (&["calibrate", "verify"], &LIVE),
            (&["calibrate", "intrinsics"], &LIVE),
        ];
        for (names, options) in lists {
            let command = (names.iter()).fold(&program, |command, name| {
                command.find_subcommand(name).unwrap()
            });
            for (option, setting) in options {
                let arg = command.get_arguments().find(|a| a.get_id() == option);
                let help = arg.unwrap().get_help().unwrap().to_string();
                let shown = help
                    .rsplit_once("[default: ")
                    .map(|(_, rest)| rest.trim_end_matches(']'));
                assert_eq!(
                    shown.map(str::to_owned),
                    default_value(setting),
                    "{names:?} {option}"
                );
            }
        }
        let webcam = program.find_subcommand("webcam").unwrap();
        let arg = |name: &str| webcam.get_arguments().find(|a| a.get_id() == name).unwrap();
        for (option, default) in WEBCAM {
            let help = arg(option).get_help().unwrap().to_string();
            assert!(help.ends_with(&format!("[default: {default}]")), "{help}");
        }
        assert!(arg("config").is_hide_set(), "it is refused");
        assert_eq!(
            default_value("environment.light_count").as_deref(),
            Some("64")
        );
    }
}
