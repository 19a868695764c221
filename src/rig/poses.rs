//! The scene camera's poses as a file, a line for each picture.

use super::RigError;
use super::prepare::Prepared;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// What the columns are: `world_from_camera` (metres, OpenCV's axes; a unit quaternion), empty
/// where no pose is known.
const HEADER: &str =
    "picture,captured_ns,x,y,z,qw,qx,qy,qz,source,answer,sigma_mm,sigma_deg,sigma_px";

/// A CSV file of poses.
pub(super) struct PoseFile {
    path: PathBuf,
    file: BufWriter<File>,
}

impl PoseFile {
    /// Begins it.
    ///
    /// # Errors
    /// It is there, and may not be replaced; it cannot be written.
    pub fn create(path: &Path, force: bool) -> Result<Self, RigError> {
        if !force && path.exists() {
            return Err(RigError::PosesThere { path: path.into() });
        }
        let file = File::create(path).map_err(|source| RigError::Write {
            path: path.into(),
            source,
        })?;
        let mut poses = Self {
            path: path.into(),
            file: BufWriter::new(file),
        };
        poses.put(|file| writeln!(file, "{HEADER}"))?;
        Ok(poses)
    }

    /// The pose that a picture was composed by.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&mut self, prepared: &Prepared) -> Result<(), RigError> {
        let frame = &prepared.frame;
        let registration = &prepared.registration;
        let answer = super::status::answer(frame.pose.as_ref()).name();
        self.put(|file| {
            write!(file, "{},{}", prepared.index, frame.captured_at.as_nanos())?;
            match prepared.world_from_camera {
                Some(pose) => {
                    let (p, q) = (pose.translation, pose.rotation);
                    write!(
                        file,
                        ",{},{},{},{},{},{},{}",
                        p.x, p.y, p.z, q.w, q.x, q.y, q.z
                    )?;
                }
                None => write!(file, ",,,,,,,")?,
            }
            write!(file, ",{},{answer}", registration.source.name())?;
            for sigma in [
                registration.sigma_mm,
                registration.sigma_deg,
                registration.sigma_px,
            ] {
                match sigma {
                    Some(sigma) => write!(file, ",{sigma:.5}")?,
                    None => write!(file, ",")?,
                }
            }
            writeln!(file)
        })
    }

    /// The last line is on the disk.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(mut self) -> Result<(), RigError> {
        self.put(Write::flush)
    }

    fn put(
        &mut self,
        what: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
    ) -> Result<(), RigError> {
        what(&mut self.file).map_err(|source| RigError::Write {
            path: self.path.clone(),
            source,
        })
    }
}
