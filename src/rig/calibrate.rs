//! Pictures to calibrate from: of a session, or of a folder.

use super::RigError;
use crate::config::Config;
use crate::picture::{Picture, decode_into};
use crate::session::{Camera, Session, SessionEvent};
use std::path::{Path, PathBuf};

/// Pictures of a session that are nearer in time show the board in the same place, seconds.
const SPACING: f64 = 0.2;
/// Pictures of a session that are looked at; a longer one is looked at less often.
const MOST_PICTURES: f64 = 600.0;

/// One picture on its way to an estimator.
#[derive(Debug)]
pub struct Looked<'a> {
    /// A file's name, or seconds from the session's start.
    pub name: String,
    /// Decoded.
    pub picture: &'a Picture,
    /// How much of all has been looked at, 0 to 1.
    pub share: f64,
}

/// Shows `visit` the pictures of one camera in `session`, base exposures only, some five a
/// second; returns how many could not be decoded.
///
/// # Errors
/// The session cannot be read.
pub fn pictures_of_session(
    session: &Session,
    camera: Camera,
    config: &Config,
    mut visit: impl FnMut(Looked),
) -> Result<usize, RigError> {
    let Some((start, end)) = session.span() else {
        return Ok(0);
    };
    let length = end.seconds_since(start);
    let spacing = SPACING.max(length / MOST_PICTURES);
    let mut picture = Picture::default();
    let (mut next, mut damaged) = (f64::MIN, 0);
    for event in session.events() {
        let frame = match (event?, camera) {
            (SessionEvent::Scene(frame), Camera::Scene) => frame,
            (SessionEvent::Environment(frame), Camera::Environment) => frame,
            _ => continue,
        };
        let at = frame.arrived_at.seconds_since(start);
        if frame.bracket_ev != 0.0 || at < next {
            continue;
        }
        next = at + spacing;
        if decode_into(&frame, &config.input.encoding(), &mut picture).is_err() {
            damaged += 1;
            continue;
        }
        visit(Looked {
            name: format!("{at:.2} s"),
            picture: &picture,
            share: (at / length.max(1e-9)).clamp(0.0, 1.0),
        });
    }
    Ok(damaged)
}

/// Shows `visit` the JPEG and PNG pictures of a folder, in the order of their names; returns
/// how many could not be decoded.
///
/// # Errors
/// No such folder, no picture in it, a file that cannot be read.
pub fn pictures_of_folder(folder: &Path, mut visit: impl FnMut(Looked)) -> Result<usize, RigError> {
    let unreadable = |path: &Path, source: std::io::Error| RigError::Pictures {
        path: path.to_owned(),
        reason: source.to_string(),
    };
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect())
        .map_err(|e| unreadable(folder, e))?;
    files.retain(|path| is_picture(path));
    files.sort();
    if files.is_empty() {
        return Err(RigError::Pictures {
            path: folder.to_owned(),
            reason: "there is no .jpg, .jpeg or .png in it".to_owned(),
        });
    }
    let mut damaged = 0;
    for (i, path) in files.iter().enumerate() {
        let bytes = std::fs::read(path).map_err(|e| unreadable(path, e))?;
        let Ok(picture) = Picture::from_file_bytes(&bytes) else {
            damaged += 1;
            continue;
        };
        let name = path.file_name().unwrap_or_default();
        visit(Looked {
            name: name.to_string_lossy().into_owned(),
            picture: &picture,
            share: (i + 1) as f64 / files.len() as f64,
        });
    }
    Ok(damaged)
}

fn is_picture(path: &Path) -> bool {
    let known = ["jpg", "jpeg", "png"];
    path.extension()
        .is_some_and(|e| known.iter().any(|k| e.eq_ignore_ascii_case(k)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::session::SessionWriter;
    use penumbra_interface::{Frame, MonotonicTime, PixelFormat};

    fn frame(millis: i64, bracket_ev: f64) -> Frame {
        let at = MonotonicTime::from_nanos(1_000_000_000 + millis * 1_000_000);
        Frame {
            data: vec![128; 16 * 8].into(),
            format: PixelFormat::Grey8,
            width: 16,
            height: 8,
            stride: 0,
            sequence: millis.unsigned_abs(),
            captured_at: at,
            arrived_at: at,
            exposure: None,
            bracket_ev,
            controls: None,
        }
    }

    #[test]
    fn a_sessions_pictures_come_five_a_second_and_without_brackets() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut writer = SessionWriter::create(&path).unwrap();
        for i in 0..60 {
            let ev = if i % 2 == 1 { -4.0 } else { 0.0 };
            writer
                .frame(Camera::Environment, &frame(33 * i, ev))
                .unwrap();
            writer.frame(Camera::Scene, &frame(33 * i, 0.0)).unwrap();
        }
        writer.finish().unwrap();
        let session = Session::open(&path).unwrap();
        let mut seen = Vec::new();
        let look = |looked: Looked| seen.push((looked.name, looked.picture.width, looked.share));
        let damaged =
            pictures_of_session(&session, Camera::Environment, &Config::default(), look).unwrap();
        assert_eq!(damaged, 0);
        assert!((8..=11).contains(&seen.len()), "{seen:?}");
        assert!(
            seen.windows(2).all(|w| w[0].2 < w[1].2) && seen[0].1 == 16,
            "{seen:?}"
        );
    }

    #[test]
    fn a_folder_without_pictures_is_told_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = pictures_of_folder(folder.path(), |_| panic!("no picture")).unwrap_err();
        assert!(error.to_string().contains("no .jpg"), "{error}");
        std::fs::write(folder.path().join("a.JPG"), b"no picture").unwrap();
        assert_eq!(
            pictures_of_folder(folder.path(), |_| panic!("broken")).unwrap(),
            1
        );
        let none = folder.path().join("none");
        let error = pictures_of_folder(&none, |_| ()).unwrap_err().to_string();
        assert!(error.contains("none") && !error.contains('\n'), "{error}");
    }
}
