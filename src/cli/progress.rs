//! The progress bar of long-running commands.

use indicatif::{ProgressBar, ProgressStyle};

/// Creates a progress bar of 1000 units that ends in `tail`, an indicatif template such as `{eta}`.
/// indicatif hides the bar if standard error is not a terminal.
pub fn progress_bar(tail: &str) -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template(&format!("{{bar:30}} {{percent}} % {tail}")) {
        bar.set_style(style);
    }
    bar
}
