//! `penumbra photo --browser`: ball and ground are adjusted on a page, and the picture composed on request.

use super::describe::describe;
use super::{Composed, PhotoArgs, write_session};
use crate::cli::{files, one_line, say};
use anyhow::bail;
use penumbra_photo::{Analysis, GroundFrom, PhotoOptions, Photographs};
use penumbra_photo_page::{Adjustment, Composite, PhotoPage, Request};
use penumbra_rig::service::Service;
use penumbra_status::PageServer;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A result that may be written.
struct Attempt {
    adjustment: Adjustment,
    analysis: Analysis,
    composed: Composed,
}

/// Serves the page until the user is done, then writes what was composed last.
pub fn run(
    args: &PhotoArgs,
    photographs: Photographs,
    options: PhotoOptions,
) -> anyhow::Result<ExitCode> {
    let options = with_ground(args, &photographs, options);
    let page = PhotoPage::new(photographs, options, args.out.display().to_string())?;
    let server = PageServer::bind(page.routes())?;
    say(format_args!("adjust ball and ground: {}", server.address()));
    let shutdown = Arc::new(AtomicBool::new(false));
    let _service = Service::serving(server.serve(), Arc::clone(&shutdown))?;
    let mut last = None;
    while let Some(request) = page.next(&shutdown) {
        match request {
            Request::Compose(adjustment) => match attempt(args, &page, adjustment, &shutdown) {
                Ok(attempt) => {
                    page.show(Ok(attempt.shown()));
                    last = Some(attempt);
                }
                Err(error) => page.show(Err(one_line(error))),
            },
            Request::Finish => {
                let written = last.as_ref().map_or(Ok(()), |attempt| attempt.write(args));
                page.take_leave(written.as_ref().err().map(one_line));
                written?;
                last.iter().for_each(|attempt| attempt.tell(&page));
                return Ok(ExitCode::SUCCESS);
            }
        }
    }
    bail!("interrupted; nothing was written")
}

/// Returns the options with the tilt that the ball's shadow tells, if nothing is stated and it can be told: the page
/// begins with it.
fn with_ground(args: &PhotoArgs, photographs: &Photographs, options: PhotoOptions) -> PhotoOptions {
    let learned = || {
        let mut analysis = photographs.analyse(&options).ok()?;
        if analysis.placement.ground != GroundFrom::Assumed {
            return None;
        }
        let folder = tempfile::tempdir().ok()?;
        write_session(
            &mut analysis,
            &folder.path().join("photographs.mcap"),
            args.size,
        )
        .ok()?;
        let is_told = matches!(analysis.placement.ground, GroundFrom::Shadow { .. });
        is_told.then(|| analysis.placement.tilt_degrees.round())
    };
    let tilt_degrees = options.tilt_degrees.or_else(learned);
    PhotoOptions {
        tilt_degrees,
        ..options
    }
}

/// Composes the picture of an adjustment.
fn attempt(
    args: &PhotoArgs,
    page: &PhotoPage,
    adjustment: Adjustment,
    shutdown: &Arc<AtomicBool>,
) -> anyhow::Result<Attempt> {
    let options = page.options(&adjustment);
    let mut analysis = page.photographs().analyse(&options)?;
    let composed = Composed::new(args, &mut analysis, shutdown)?;
    Ok(Attempt {
        adjustment,
        analysis,
        composed,
    })
}

impl Attempt {
    /// What there is to say about it, the check last.
    fn lines(&self) -> Vec<String> {
        let mut lines = describe(&self.analysis);
        lines.push(self.composed.check.clone());
        lines
    }

    fn shown(&self) -> Composite {
        Composite {
            png: self.composed.picture.clone().into(),
            lines: self.lines(),
        }
    }

    fn write(&self, args: &PhotoArgs) -> anyhow::Result<()> {
        if let Some(path) = &args.found {
            files::write(
                path,
                &penumbra_photo::png(&self.analysis.drawn())?,
                args.force,
            )?;
        }
        self.composed.write(args)
    }

    fn tell(&self, page: &PhotoPage) {
        self.lines().into_iter().for_each(say);
        say(format_args!(
            "the same without a browser: {}",
            page.command_line_options(&self.adjustment)
        ));
    }
}
