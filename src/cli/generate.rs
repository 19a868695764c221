//! `penumbra completions` and `penumbra man`: shell completions and man pages from the definition of
//! the command line; `penumbra schema`: the JSON schema of rig.json.

use super::files::refuse_overwriting;
use anyhow::anyhow;
use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use penumbra_picture::write_whole;
use penumbra_rig_model::rig_json_schema;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder of the pages; it is created
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// Prints the completions for a shell.
pub fn completions(args: &CompletionsArgs) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::command(), "penumbra", &mut script);
    super::say(String::from_utf8(script)?.trim_end());
    Ok(ExitCode::SUCCESS)
}

/// Prints the JSON schema of rig.json.
pub fn schema() -> anyhow::Result<ExitCode> {
    super::say(serde_json::to_string_pretty(&rig_json_schema())?);
    Ok(ExitCode::SUCCESS)
}

/// Writes a page for the program and for each of its commands.
pub fn man(args: &ManArgs) -> anyhow::Result<ExitCode> {
    let pages = pages()?;
    let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
    refuse_overwriting(&args.folder, &names, args.force)?;
    let problem =
        |path: &PathBuf, error| anyhow!("{}: cannot be written ({error})", path.display());
    std::fs::create_dir_all(&args.folder).map_err(|error| problem(&args.folder, error))?;
    for (name, page) in &pages {
        let path = args.folder.join(name);
        write_whole(&path, |part| std::fs::write(part, page))
            .map_err(|error| problem(&path, error))?;
    }
    super::say(format_args!(
        "{}: {} pages",
        args.folder.display(),
        pages.len()
    ));
    Ok(ExitCode::SUCCESS)
}

/// Returns the man pages with their file names.
fn pages() -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let mut program = super::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    add_pages(&program, &mut pages)?;
    Ok(pages)
}

fn add_pages(command: &Command, pages: &mut Vec<(String, Vec<u8>)>) -> std::io::Result<()> {
    let name = command
        .get_display_name()
        .unwrap_or_else(|| command.get_name())
        .to_owned();
    let mut page = Vec::new();
    Man::new(command.clone()).render(&mut page)?;
    pages.push((format!("{name}.1"), page));
    for child in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        add_pages(child, pages)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn every_command_has_a_man_page_with_its_examples() {
        let pages = pages().unwrap();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        for expected in [
            "penumbra.1",
            "penumbra-replay.1",
            "penumbra-calibrate-verify.1",
        ] {
            assert!(names.contains(&expected), "{expected}: {names:?}");
        }
        let info = pages.iter().find(|(name, _)| name == "penumbra-info.1");
        let text = String::from_utf8(info.unwrap().1.clone()).unwrap();
        assert!(text.contains("penumbra info desk.mcap"), "{text}");
    }

    #[test]
    fn every_shell_completes_the_commands() {
        for shell in Shell::value_variants() {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut crate::cli::command(), "penumbra", &mut script);
            let script = String::from_utf8(script).unwrap();
            assert!(script.contains("check-config"), "{shell}");
        }
    }
}
