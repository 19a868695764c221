//! Examples of every command. They are part of the help, of the man pages and of the book.

use clap::Command;

/// Commands by their words, with examples: a line, and what it does.
const EXAMPLES: &[(&str, &[(&str, &str)])] = &[
    (
        "replay",
        &[
            (
                "penumbra replay desk.mcap",
                "in a window and at http://127.0.0.1:8780",
            ),
            (
                "penumbra replay desk.mcap --scene scene.toml --loop --headless",
                "other virtual objects, repeated, in the browser alone",
            ),
            (
                "penumbra replay desk.mcap --headless --speed max --quality best --frames-out frames",
                "every picture as a file, as good as it gets",
            ),
        ],
    ),
    (
        "run",
        &[
            (
                "penumbra run --config rig.toml",
                "the rig of a configuration",
            ),
            (
                "penumbra run --config rig.toml --headless --listen 0.0.0.0:8780 --token a-long-secret",
                "status page for other machines",
            ),
        ],
    ),
    (
        "webcam",
        &[
            (
                "penumbra webcam --ball-mm 70",
                "the first camera; writes webcam/sheet.pdf to print",
            ),
            (
                "penumbra webcam --camera simulated --size 640x480",
                "without a camera, printer and ball",
            ),
            (
                "penumbra webcam --paper letter --ruler-mm 97 --prepare-only",
                "a sheet that was printed too small",
            ),
        ],
    ),
    (
        "record",
        &[
            (
                "penumbra record desk.mcap --config rig.toml --duration 60",
                "a minute, then it ends",
            ),
            (
                "penumbra record desk.mcap --while-running",
                "with the `penumbra run` that is running",
            ),
        ],
    ),
    (
        "bake",
        &[
            (
                "penumbra bake desk.mcap",
                "a recording's object, into the cache",
            ),
            (
                "penumbra bake gate.glb --session yard.mcap --planes 64 --out gate.bake",
                "a model before a recording's phantoms, into a file",
            ),
        ],
    ),
    (
        "import",
        &[(
            "penumbra import desk/ desk.mcap",
            "a folder of pictures, times and poses",
        )],
    ),
    (
        "info",
        &[
            (
                "penumbra info desk.mcap",
                "streams, rates, gaps, attachments",
            ),
            ("penumbra info desk.mcap --json", "the same for scripts"),
        ],
    ),
    (
        "light",
        &[
            (
                "penumbra light ball.jpg --kind sphere --out light",
                "from a photograph",
            ),
            (
                "penumbra light desk.mcap --out light --json",
                "from a recording, figures as JSON",
            ),
        ],
    ),
    (
        "photo",
        &[
            (
                "penumbra photo empty.jpg ball1.jpg ball2.jpg --ball-diameter 80mm -o composite.png",
                "from photographs with a phone; the ball in two exposures",
            ),
            (
                "penumbra photo empty.jpg ball.jpg --ball-diameter 80mm --browser -o composite.png",
                "the same; ball and ground are adjusted in the browser",
            ),
            (
                "penumbra photo empty.jpg ball.jpg --ball-diameter 8cm --tag tag36h11:60mm --scene scene.toml --found found.png -o composite.png",
                "own objects on the ground of a printed tag, and a picture of what was found",
            ),
        ],
    ),
    (
        "calibrate intrinsics",
        &[(
            "penumbra calibrate intrinsics --session board.mcap --board chess:9x6:0.025 --out rig/calibration/scene_camera.json",
            "the scene camera's lens",
        )],
    ),
    (
        "calibrate environment",
        &[
            (
                "penumbra calibrate environment --session motion.mcap --rig rig --out rig/calibration/environment.json",
                "a fisheye",
            ),
            (
                "penumbra calibrate environment --session motion.mcap --rig rig --kind sphere --click 320,240 --out environment.json",
                "a mirrored sphere about pixel 320, 240",
            ),
        ],
    ),
    (
        "calibrate map",
        &[(
            "penumbra calibrate map --session motion.mcap --size 0.08 --out rig/calibration/markers.json",
            "tags whose black border is 8 cm",
        )],
    ),
    (
        "calibrate latency",
        &[(
            "penumbra calibrate latency --session motion.mcap --rig rig --out rig/calibration/latency.json",
            "from brisk rotations",
        )],
    ),
    (
        "calibrate tracker",
        &[(
            "penumbra calibrate tracker --session motion.mcap --rig rig --out rig/calibration/tracker.json",
            "with the markers in rig/",
        )],
    ),
    (
        "calibrate board",
        &[(
            "penumbra calibrate board --board charuco:8x5:0.03:0.022:4x4_50 --out board.pdf",
            "to print at true scale",
        )],
    ),
    (
        "calibrate verify",
        &[
            (
                "penumbra calibrate verify --session check.mcap --out check.json",
                "a recording",
            ),
            (
                "penumbra calibrate verify --config rig.toml",
                "the live rig",
            ),
        ],
    ),
    (
        "calibrate radiometric",
        &[
            (
                "penumbra calibrate radiometric --session chart.mcap --out rig/calibration/radiometric.json",
                "a chart",
            ),
            (
                "penumbra calibrate radiometric --scene-series photos --exposures 1/30,1/60,1/125 --out radiometric.json",
                "a tone curve from pictures of three exposures",
            ),
        ],
    ),
    (
        "calibrate tags",
        &[(
            "penumbra calibrate tags --pictures photos --family tag36h11,4x4_50 --out tags.csv",
            "two families",
        )],
    ),
    (
        "calibrate convert",
        &[(
            "penumbra calibrate convert rig/calibration/scene_camera.json --to ros --out camera_info.yaml",
            "for ROS",
        )],
    ),
    (
        "check-config",
        &[
            ("penumbra check-config rig.toml", "what it changes"),
            (
                "penumbra check-config rig.toml --all",
                "every setting with the value in effect",
            ),
        ],
    ),
    (
        "devices",
        &[
            ("penumbra devices", "cameras and serial ports"),
            (
                "penumbra devices --probe --json",
                "with the trackers' answers, for scripts",
            ),
        ],
    ),
    (
        "doctor",
        &[
            ("penumbra doctor", "what works on this machine"),
            ("penumbra doctor --json", "the same for scripts"),
        ],
    ),
    (
        "bench",
        &[
            (
                "penumbra bench --case supan --size 1920x1080 --frames 50",
                "one table in another size",
            ),
            (
                "penumbra bench --case live --json live.json",
                "a live rig's times, also as a file",
            ),
        ],
    ),
    (
        "simulate tracker",
        &[
            (
                "penumbra simulate tracker --protocol fastrak --pty tracker.pty",
                "at a pseudo-terminal",
            ),
            (
                "penumbra simulate tracker --protocol freed --udp 127.0.0.1:40000 --trajectory poses.txt",
                "datagrams of a path from a file",
            ),
        ],
    ),
    (
        "simulate session",
        &[(
            "penumbra simulate session --seconds 20 --known-markers --out rig.mcap --truth rig_truth.json",
            "to try the calibration on",
        )],
    ),
    (
        "completions",
        &[(
            "penumbra completions bash",
            "for ~/.local/share/bash-completion/completions/penumbra",
        )],
    ),
    (
        "man",
        &[(
            "penumbra man target/man",
            "penumbra.1, penumbra-replay.1 and so on",
        )],
    ),
    (
        "schema",
        &[(
            "penumbra schema",
            "for editors that check rig.json as it is written",
        )],
    ),
];

/// What all commands have in common.
const COMMON: &str = "Exit status:
  0  done
  1  failed; one line on standard error says what, where and what to do. Also a refused calibration,
     an invalid configuration, and a machine on which `doctor` finds that nothing works
  2  the command line is wrong
  130  a second Ctrl-C ended a calibration; nothing was written

Standard output has the result alone; progress, warnings and errors go to standard error. Options
that replace a setting default to the file of --config, and else to the default in the book's page
Configuration; `penumbra check-config FILE --all` prints the values in effect.";

/// Adds examples and exit status to the help of the program and of its commands.
pub fn add_to(program: Command) -> Command {
    let program = program.after_long_help(COMMON).after_help(COMMON);
    EXAMPLES.iter().fold(program, |program, (name, examples)| {
        let words: Vec<&str> = name.split(' ').collect();
        add(program, &words, &text(examples))
    })
}

fn add(command: Command, words: &[&str], text: &str) -> Command {
    match words {
        [] => command.after_help(text.to_owned()),
        [first, rest @ ..] => command.mut_subcommand(first, |c| add(c, rest, text)),
    }
}

fn text(examples: &[(&str, &str)]) -> String {
    let each = examples
        .iter()
        .map(|(line, meaning)| format!("  {line}\n      {meaning}"));
    format!("Examples:\n{}", each.collect::<Vec<_>>().join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the words of the commands that do something.
    fn leaves(command: &Command, words: &str, out: &mut Vec<String>) {
        let mut children = command
            .get_subcommands()
            .filter(|c| c.get_name() != "help" && !c.is_hide_set())
            .peekable();
        if children.peek().is_none() {
            out.push(words.trim().to_owned());
        }
        for child in children {
            leaves(child, &format!("{words} {}", child.get_name()), out);
        }
    }

    #[test]
    fn every_command_has_examples_that_parse() {
        let mut commands = Vec::new();
        leaves(&crate::cli::command(), "", &mut commands);
        for command in commands {
            let found = EXAMPLES.iter().find(|(name, _)| *name == command);
            let (_, examples) = found.unwrap_or_else(|| panic!("{command}: has no example"));
            for (line, _) in *examples {
                assert!(line.starts_with(&format!("penumbra {command}")), "{line}");
                let parsed = crate::cli::command().try_get_matches_from(line.split(' '));
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
            }
        }
    }

    #[test]
    fn help_has_examples_and_exit_status() {
        let mut program = crate::cli::command();
        let help = program.render_help().to_string();
        assert!(help.contains("Exit status:"), "{help}");
        let info = program.find_subcommand_mut("info").unwrap();
        let help = info.render_help().to_string();
        assert!(help.contains("penumbra info desk.mcap --json"), "{help}");
    }
}
