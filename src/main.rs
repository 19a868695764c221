//! The `penumbra` program: its command line, the benchmark and the check of the machine.
//! Everything else is in the crates beside this file; `rig` runs them.

mod bench;
mod cli;
mod doctor;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
