//! The command line: what was typed becomes a call of the library, and what went wrong
//! one line on standard error.
//!
//! One file per command; [`files`] holds what they have in common about files that must
//! not be overwritten.

mod bake;
mod bench;
mod calibrate;
mod check;
mod devices;
mod files;
mod import;
mod light;
mod live;
mod ports;
mod quiet;
mod record;
mod replay;
mod show;
mod simulate;

use clap::{Parser, Subcommand};
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

/// Augmented reality whose virtual objects share the light, reflections and soft shadows
/// of the real scene.
#[derive(Debug, Parser)]
#[command(name = "penumbra", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Play a recorded session through the compositor: to a window, to a browser, to files
    Replay(Box<replay::ReplayArgs>),
    /// Run a live rig: cameras and tracker to a window, to a browser, to files
    Run(Box<live::RunArgs>),
    /// Record the live rig into a session, without composing anything
    Record(record::RecordArgs),
    /// Bake shadows onto planes around a scene's objects, for `--technique shadowing-planes`
    Bake(bake::BakeArgs),
    /// Make a session from a folder of pictures, time stamps and poses
    Import(import::ImportArgs),
    /// Say what is in a session: streams, rates, gaps, duration, attachments
    Info(check::InfoArgs),
    /// Write what a photograph or a session says about the light
    Light(light::LightArgs),
    /// Calibrate the rig, step by step
    Calibrate(calibrate::CalibrateArgs),
    /// Read a configuration and the files it names, and say what it changes
    CheckConfig(check::CheckConfigArgs),
    /// List the cameras, what they offer and what can be set
    Devices(devices::DevicesArgs),
    /// Say what works on this machine, and what mends the rest
    Doctor(check::DoctorArgs),
    /// Measure how long a frame takes on this machine
    Bench(bench::BenchArgs),
    /// Be a device that is not there: a tracker at a pseudo-terminal or over UDP
    Simulate(simulate::SimulateArgs),
}

/// Carries out the command line.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    quiet::silence_device_select();
    start_log();
    match carry_out(cli.command) {
        Ok(code) => code,
        Err(error) => {
            complain(&error);
            ExitCode::FAILURE
        }
    }
}

fn carry_out(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Replay(args) => replay::run(*args),
        Command::Run(args) => live::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Import(args) => import::run(args),
        Command::Info(args) => check::info(&args),
        Command::Light(args) => light::run(&args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::CheckConfig(args) => check::check_config(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Doctor(args) => check::doctor(args),
        Command::Bench(args) => bench::run(args),
        Command::Simulate(args) => simulate::run(args),
    }
}

/// What libraries log, on standard error; `RUST_LOG` chooses. The graphics libraries'
/// warnings are about drivers, and `penumbra doctor` says them better.
fn start_log() {
    let usual = "warn,wgpu_core=error,wgpu_hal=off,naga=error,winit=error,calloop=error";
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(usual));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
}

/// One line on standard output. A reader that has gone away (`| head`) is no reason to
/// stop, so `println!`, which panics then, will not do.
fn say(text: impl Display) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// One line on standard error about what ends the program.
fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr().lock(), "penumbra: {}", one_line(error));
}

/// One line on standard error about what does not end it.
fn warn(text: impl Display) {
    let _ = writeln!(
        std::io::stderr().lock(),
        "penumbra: warning: {}",
        one_line(text)
    );
}

/// Parsers of other people like to draw pictures under their complaints.
fn one_line(text: impl Display) -> String {
    let text = text.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_makes_sense_to_clap() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_complaint_of_many_lines_becomes_one() {
        assert_eq!(one_line("a\n  |\n1 | b"), "a | 1 | b");
    }
}
