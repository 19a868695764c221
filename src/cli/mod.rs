//! The command line: parses the arguments, calls the libraries, and prints errors as one line on
//! standard error.
//!
//! One file per command; [`files`] creates output files without overwriting existing ones.

mod bake;
mod bench;
mod calibrate;
mod check;
mod defaults;
mod devices;
mod examples;
mod files;
mod generate;
mod import;
mod light;
mod live;
mod page_log;
mod photo;
mod ports;
mod progress;
mod quiet;
mod record;
mod replay;
mod show;
mod simulate;
mod webcam;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use page_log::PageLog;
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::OnceLock;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Augmented reality whose virtual objects share the light, reflections and soft shadows
/// of the real scene.
#[derive(Debug, Parser)]
#[command(name = "penumbra", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Show no progress
    #[arg(long, short, global = true)]
    quiet: bool,
}

/// Returns the definition of the command line, with defaults and examples.
fn command() -> clap::Command {
    examples::add_to(defaults::add_to(Cli::command()))
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Play a recorded session through the compositor: to a window, to a browser, to files
    Replay(Box<replay::ReplayArgs>),
    /// Run a live rig: cameras and tracker to a window, to a browser, to files
    Run(Box<live::RunArgs>),
    /// Set up and run a webcam's rig: a printed sheet with tags, and a shiny ball on it
    Webcam(Box<webcam::WebcamArgs>),
    /// Record the live rig into a session without compositing
    Record(record::RecordArgs),
    /// Bake shadows onto planes around a scene's objects in advance, for `--technique shadowing-planes`
    Bake(bake::BakeArgs),
    /// Convert a folder of pictures, time stamps and poses into a session
    Import(import::ImportArgs),
    /// Print the contents of a session: streams, rates, gaps, duration, attachments
    Info(check::InfoArgs),
    /// Estimate the lighting from a photograph or a session
    Light(light::LightArgs),
    /// Put virtual objects into a photograph, under the light that a mirrored ball showed
    Photo(Box<photo::PhotoArgs>),
    /// Calibrate the rig, step by step
    Calibrate(calibrate::CalibrateArgs),
    /// Check a configuration and the files it names, and print the settings that it changes
    CheckConfig(check::CheckConfigArgs),
    /// List the cameras with their modes and controls, and the serial ports
    Devices(devices::DevicesArgs),
    /// Check what works on this machine, and print how to fix the rest
    Doctor(check::DoctorArgs),
    /// Measure the time per frame on this machine
    Bench(bench::BenchArgs),
    /// Simulate a device or a rig: a tracker at a pseudo-terminal or over UDP, or recordings
    Simulate(simulate::SimulateArgs),
    /// Print a shell's completions of this command line
    Completions(generate::CompletionsArgs),
    /// Write the man pages of all commands
    Man(generate::ManArgs),
    /// Print the JSON schema of rig.json
    Schema,
}

/// Runs the command of the command line.
pub fn run() -> ExitCode {
    let parsed = command().try_get_matches();
    let cli = match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return refuse(&error),
    };
    if cli.quiet {
        progress::silence();
    }
    quiet::silence_device_select();
    start_log();
    let outcome = carry_out(cli.command);
    match outcome.and_then(|code| check_output().map(|()| code)) {
        Ok(code) => code,
        Err(error) => {
            complain(&error);
            ExitCode::FAILURE
        }
    }
}

/// Prints the error of a command line, or the help that was asked for. Former names are refused
/// with the new name.
fn refuse(error: &clap::Error) -> ExitCode {
    if let Some(message) = renamed(error) {
        let _ = writeln!(std::io::stderr().lock(), "penumbra: {message}");
    } else if let Err(source) = error.print().and_then(|()| std::io::stdout().flush()) {
        complain(&output_error(&source));
        return ExitCode::FAILURE;
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}

/// The message about a former name on the command line.
fn renamed(error: &clap::Error) -> Option<String> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.split_whitespace().next().unwrap_or_default(),
        _ => "",
    };
    let (option, value) = match error.kind() {
        ErrorKind::InvalidSubcommand => ("", text(ContextKind::InvalidSubcommand)),
        // Another command may have an option of that name.
        ErrorKind::UnknownArgument => (text(ContextKind::InvalidArg), ""),
        _ => (
            text(ContextKind::InvalidArg),
            text(ContextKind::InvalidValue),
        ),
    };
    penumbra_config::renamed_word(option, value)
}

fn carry_out(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Replay(args) => replay::run(*args),
        Command::Run(args) => live::run(&args),
        Command::Webcam(args) => webcam::run(*args),
        Command::Record(args) => record::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Import(args) => import::run(args),
        Command::Info(args) => check::info(&args),
        Command::Light(args) => light::run(&args),
        Command::Photo(args) => photo::run(&args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::CheckConfig(args) => check::check_config(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Doctor(args) => check::doctor(args),
        Command::Bench(args) => bench::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Completions(args) => generate::completions(&args),
        Command::Man(args) => generate::man(&args),
        Command::Schema => generate::schema(),
    }
}

/// Sends the libraries' log to standard error; `RUST_LOG` sets the filter. Warnings of the graphics
/// libraries are about drivers, which `penumbra doctor` reports better.
fn start_log() {
    let default = "warn,wgpu_core=error,wgpu_hal=off,naga=error,winit=error,calloop=error";
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .finish()
        .with(PageLog)
        .init();
}

/// The first error of standard output.
static OUTPUT_ERROR: OnceLock<std::io::Error> = OnceLock::new();

/// Prints one line to standard output. A closed pipe (`| head`) is ignored; `println!` would panic.
/// Another error, such as a full disk, makes the program fail at its end.
fn say(text: impl Display) {
    let mut out = std::io::stdout().lock();
    let printed = writeln!(out, "{text}").and_then(|()| out.flush());
    if let Err(error) = printed
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        let _ = OUTPUT_ERROR.set(error);
    }
}

/// Returns the error of standard output if what was printed did not arrive.
fn check_output() -> anyhow::Result<()> {
    match OUTPUT_ERROR.get() {
        None => Ok(()),
        Some(error) => Err(output_error(error)),
    }
}

fn output_error(error: &std::io::Error) -> anyhow::Error {
    anyhow::anyhow!("standard output cannot be written ({error}); free space")
}

/// Prints an error that ends the program to standard error.
fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr().lock(), "penumbra: {}", one_line(error));
}

/// Prints a warning to standard error.
fn warn(text: impl Display) {
    let _ = writeln!(
        std::io::stderr().lock(),
        "penumbra: warning: {}",
        one_line(text)
    );
}

/// Joins a message of several lines, e.g. of a parser, into one.
fn one_line(text: impl Display) -> String {
    let text = text.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write as _;

    #[test]
    fn command_line_definition_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn refuses_former_words_with_the_new_ones() {
        for (line, expected) in [
            (
                "replay a.mcap --lights grid",
                "`--lights` is now called `--light-placement`",
            ),
            (
                "run --technique dome",
                "--technique: `dome` is now called `image-based-shadowing`",
            ),
            (
                "run --technique=planes",
                "--technique: `planes` is now called `shadowing-planes`",
            ),
            (
                "replay a.mcap --pairing whole",
                "--pairing: `whole` is now called `complete`",
            ),
            (
                "calibrate photometric --session a.mcap",
                "`photometric` is now called `radiometric`",
            ),
        ] {
            let words = std::iter::once("penumbra").chain(line.split(' '));
            let message = Cli::try_parse_from(words).err().and_then(|e| renamed(&e));
            assert_eq!(message.as_deref(), Some(expected), "{line}");
        }
    }

    /// `UPDATE_DOCS=1 cargo test --bin penumbra command_line_page` rewrites the page.
    #[test]
    fn command_line_page_matches_the_options() {
        let mut page = String::from(
            "# Command line\n\nGenerated from the program's options. `penumbra COMMAND --help` \
             prints the same.\n",
        );
        let mut cli = command();
        cli.build();
        let _ = write!(page, "\n## `penumbra`\n\n```text\n{}\n```\n", help_of(&cli));
        for command in cli.get_subcommands_mut() {
            describe(command, &mut page);
        }
        penumbra_test_data::check_page("docs/src/command-line.md", &page);
    }

    /// Appends the help of a command and its subcommands.
    fn describe(command: &mut clap::Command, page: &mut String) {
        if command.get_name() == "help" || command.is_hide_set() {
            return;
        }
        let name = command.get_bin_name().unwrap_or_default().to_owned();
        let level = "#".repeat(name.split(' ').count());
        let help = help_of(command);
        let _ = write!(page, "\n{level} `{name}`\n\n```text\n{help}\n```\n");
        for subcommand in command.get_subcommands_mut() {
            describe(subcommand, page);
        }
    }

    fn help_of(command: &clap::Command) -> String {
        let help = command.clone().term_width(100).render_long_help();
        let help = help.to_string();
        let lines: Vec<&str> = help.lines().map(str::trim_end).collect();
        lines.join("\n").trim_end().to_owned()
    }

    #[test]
    fn joins_a_message_of_several_lines() {
        assert_eq!(one_line("a\n  |\n1 | b"), "a | 1 | b");
    }
}
