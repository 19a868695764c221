//! Writes the scene camera's poses to a CSV file, one line per picture.

use crate::error::RigError;
use crate::frame::PreparedFrame;
use penumbra_interface::RigidTransform;
use penumbra_output::OutputError;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Columns: `world_from_camera` (metres, OpenCV's axes; a unit quaternion), empty without a pose;
/// then the pose predicted for the instant at which the picture is seen, empty without prediction.
const HEADER: &str = "picture,captured_ns,x,y,z,qw,qx,qy,qz,source,answer,sigma_mm,sigma_deg,\
                      sigma_px,shown_ns,shown_x,shown_y,shown_z,shown_qw,shown_qx,shown_qy,\
                      shown_qz,shown_sigma_mm,shown_sigma_deg,shown_sigma_px";

/// A CSV file of poses.
pub(super) struct PoseFile {
    path: PathBuf,
    file: BufWriter<Box<dyn Write + Send>>,
}

impl PoseFile {
    /// Creates the file and writes its header.
    ///
    /// # Errors
    /// The file exists and `force` is false, or it cannot be written.
    pub fn create(path: &Path, force: bool) -> Result<Self, RigError> {
        if !force && path.exists() {
            return Err(RigError::PosesFileExists { path: path.into() });
        }
        let file = File::create(path).map_err(|source| OutputError::Write {
            path: path.into(),
            source,
        })?;
        let mut poses = Self {
            path: path.into(),
            file: BufWriter::new(Box::new(file)),
        };
        poses.put(|file| writeln!(file, "{HEADER}"))?;
        Ok(poses)
    }

    /// Writes the pose with which a picture was composed.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, prepared: &PreparedFrame) -> Result<(), RigError> {
        let frame = &prepared.frame;
        let registration = &prepared.registration;
        let answer = crate::status::pose_answer(frame.pose.as_ref()).name();
        self.put(|file| {
            write!(file, "{},{}", prepared.index, frame.captured_at.as_nanos())?;
            write_pose(file, prepared.world_from_camera)?;
            write!(file, ",{},{answer}", registration.source.name())?;
            let r = registration;
            write_sigmas(file, [r.sigma_mm, r.sigma_deg, r.sigma_px])?;
            match prepared.display {
                Some(display) => write!(file, ",{}", display.at.as_nanos())?,
                None => write!(file, ",")?,
            }
            let display = registration.display.unwrap_or_default();
            write_pose(file, prepared.display.map(|d| d.world_from_camera))?;
            let sigmas = [display.sigma_mm, display.sigma_deg, display.sigma_px];
            write_sigmas(file, sigmas)?;
            writeln!(file)
        })
    }

    /// Writes buffered lines to the disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<(), RigError> {
        self.put(Write::flush)
    }

    fn put(
        &mut self,
        write: impl FnOnce(&mut BufWriter<Box<dyn Write + Send>>) -> std::io::Result<()>,
    ) -> Result<(), RigError> {
        let written = write(&mut self.file);
        // A part of the file is of no use. A device such as /dev/full stays.
        if written.is_err() && self.path.is_file() {
            let _ = std::fs::remove_file(&self.path);
        }
        Ok(written.map_err(|source| OutputError::Write {
            path: self.path.clone(),
            source,
        })?)
    }
}

fn write_pose(file: &mut impl Write, pose: Option<RigidTransform>) -> std::io::Result<()> {
    let Some(pose) = pose else {
        return write!(file, ",,,,,,,");
    };
    let (p, q) = (pose.translation, pose.rotation);
    let [x, y, z] = p.to_array();
    write!(file, ",{x},{y},{z},{},{},{},{}", q.w, q.x, q.y, q.z)
}

fn write_sigmas(file: &mut impl Write, sigmas: [Option<f64>; 3]) -> std::io::Result<()> {
    for sigma in sigmas {
        match sigma {
            Some(sigma) => write!(file, ",{sigma:.5}")?,
            None => write!(file, ",")?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_faulty::FaultyDisk;

    #[test]
    fn full_disk_leaves_no_part_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        let disk = FaultyDisk::default();
        let file = disk.file(File::create(&path).unwrap());
        let mut poses = PoseFile {
            path: path.clone(),
            file: BufWriter::new(Box::new(file)),
        };
        poses.put(|file| writeln!(file, "{HEADER}")).unwrap();
        poses.put(Write::flush).unwrap();
        disk.set_full(true);
        poses.put(|file| writeln!(file, "1,2")).unwrap();
        let error = poses.finish().unwrap_err().to_string();
        assert!(error.contains("poses.csv"), "{error}");
        assert!(!path.exists());
    }
}
