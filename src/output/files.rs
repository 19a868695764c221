//! Writes frames as PNG files on a separate thread.

use super::OutputError;
use crossbeam_channel::{Receiver, Sender, bounded};
use penumbra_interface::threads;
use penumbra_picture::{Picture, write_whole};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// Maximum number of queued pictures; when the queue is full the caller waits, because every frame
/// must be written.
const WAITING: usize = 4;

/// Writes `%05d.png` files into a folder.
pub struct FrameFolder {
    sender: Option<Sender<(u64, Picture)>>,
    spare: Receiver<Picture>,
    writer: Option<JoinHandle<Result<u64, OutputError>>>,
}

impl FrameFolder {
    /// Opens the folder, and creates it if it is missing.
    ///
    /// # Errors
    /// The folder cannot be created, or already holds frames and `force` is not set.
    pub fn create(path: &Path, force: bool) -> Result<Self, OutputError> {
        let failed = |source| OutputError::Write {
            path: path.to_owned(),
            source,
        };
        std::fs::create_dir_all(path).map_err(failed)?;
        let occupied = std::fs::read_dir(path)
            .map_err(failed)?
            .flatten()
            .any(|entry| entry.path().extension().is_some_and(|e| e == "png"));
        if occupied && !force {
            return Err(OutputError::Occupied {
                path: path.to_owned(),
            });
        }
        let (sender, incoming) = bounded::<(u64, Picture)>(WAITING);
        let (give_back, spare) = bounded(WAITING + 1);
        let folder = path.to_owned();
        let writer = threads::spawn("files", move || {
            let mut written = 0;
            for (index, picture) in incoming {
                write_png(&folder.join(format!("{index:05}.png")), &picture)?;
                written += 1;
                // Recycled buffers beyond the queue's capacity are dropped.
                let _ = give_back.try_send(picture);
            }
            Ok(written)
        })
        .map_err(failed)?;
        Ok(Self {
            sender: Some(sender),
            spare,
            writer: Some(writer),
        })
    }

    /// Returns a recycled buffer.
    #[must_use]
    pub fn spare(&self) -> Picture {
        self.spare.try_recv().unwrap_or_default()
    }

    /// Queues a picture. Errors of the writer are returned by [`Self::finish`].
    pub fn write(&self, index: u64, picture: Picture) {
        if let Some(sender) = &self.sender {
            let _ = sender.send((index, picture));
        }
    }

    /// Waits until all pictures are written and returns the number of files.
    ///
    /// # Errors
    /// A file could not be written.
    pub fn finish(mut self) -> Result<u64, OutputError> {
        self.sender = None;
        match self.writer.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            _ => Ok(0),
        }
    }

    /// Returns false once the writer has failed.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.writer.as_ref().is_some_and(|w| !w.is_finished())
    }
}

/// Writes one picture as an RGB PNG; equal pictures give equal bytes.
///
/// # Errors
/// The file cannot be written.
pub fn write_png(path: &Path, picture: &Picture) -> Result<(), OutputError> {
    let failed = |source: std::io::Error| OutputError::Write {
        path: PathBuf::from(path),
        source,
    };
    write_whole(path, |part| encode_png(File::create(part)?, picture)).map_err(failed)
}

fn encode_png(file: File, picture: &Picture) -> std::io::Result<()> {
    let mut encoder = png::Encoder::new(BufWriter::new(file), picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let rgb: Vec<u8> = picture
        .rgba
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]])
        .collect();
    let write = || -> Result<(), png::EncodingError> {
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&rgb)?;
        writer.finish()
    };
    write().map_err(std::io::Error::other)
}
