//! Repairs a bake after a change of the scene: bakes the images that changed, and copies the others
//! from the old bake.

use super::super::gpu::{Gpu, GpuError};
use super::baker::{Baker, Progress, faces, report};
use penumbra_scene::Scene;
use penumbra_scene::planes::renew::Renewal;
use penumbra_scene::planes::{Bake, Basis, Image, ReceiverImage, ShadowingPlane};

/// Bakes the images that `renewal` lists, and copies the others from `old`. The key is left zero.
///
/// # Errors
/// As for [`super::bake`].
pub fn repair(
    gpu: &Gpu,
    scene: &Scene,
    old: &Bake,
    renewal: &Renewal,
    progress: &mut Progress<'_>,
) -> Result<Bake, GpuError> {
    let settings = old.settings;
    let faces = faces(gpu, settings, renewal.planes.len())?;
    let lights = faces.len();
    let row = |k: usize| &renewal.drawn[k * lights..(k + 1) * lights];
    let active: Vec<usize> = (0..renewal.planes.len())
        .filter(|k| row(*k).contains(&true))
        .collect();
    let planes: Vec<ShadowingPlane> = active.iter().map(|k| renewal.planes[*k].clone()).collect();
    let mut repaired = RepairedBake::new(old, renewal, lights);
    if planes.is_empty() {
        return Ok(repaired.finish(renewal, Vec::new(), &active));
    }
    let mut baker = Baker::new(gpu, scene, &planes, settings);
    let receivers = baker.receivers(scene, &planes)?;
    let mut work = baker.work(&receivers);
    for (i, face) in faces.iter().enumerate() {
        report(progress, i, lights)?;
        if active.iter().any(|k| row(*k)[i]) {
            let drawn = work.light(&baker, face, &mut repaired.texels)?;
            for (k, basis) in active.iter().zip(drawn) {
                repaired.images[k * lights + i] = Some(basis);
            }
        }
    }
    report(progress, lights, lights)?;
    Ok(repaired.finish(renewal, receivers, &active))
}

/// A bake in the making, which reuses the unchanged images of an old one.
struct RepairedBake<'a> {
    old: &'a Bake,
    images: Vec<Option<Basis>>,
    texels: Vec<u8>,
}

impl<'a> RepairedBake<'a> {
    fn new(old: &'a Bake, renewal: &Renewal, lights: usize) -> Self {
        Self {
            old,
            images: vec![None; renewal.planes.len() * lights],
            texels: Vec::new(),
        }
    }

    /// Copies the images and receivers that were not baked again. `receivers` are those of the
    /// `active` planes.
    fn finish(
        mut self,
        renewal: &Renewal,
        receivers: Vec<ReceiverImage>,
        active: &[usize],
    ) -> Bake {
        let lights = self.images.len() / renewal.planes.len().max(1);
        for (k, from) in renewal.from.iter().enumerate() {
            let Some(from) = *from else { continue };
            for i in 0..lights {
                if self.images[k * lights + i].is_none() {
                    let basis = self.old.images.get(from * lights + i).copied();
                    self.images[k * lights + i] = basis.map(|b| self.copy(b));
                }
            }
        }
        let mut all: Vec<ReceiverImage> = renewal
            .from
            .iter()
            .map(|from| from.and_then(|f| self.old.receivers.get(f).cloned()))
            .map(Option::unwrap_or_default)
            .collect();
        for (k, receiver) in active.iter().zip(receivers) {
            all[*k] = receiver;
        }
        let black = Basis {
            past_all: Image::Black,
            past_phantoms: Image::Black,
        };
        let images = self.images.iter().map(|b| b.unwrap_or(black));
        Bake {
            key: [0; 32],
            settings: self.old.settings,
            planes: renewal.planes.clone(),
            receivers: all,
            images: images.collect(),
            texels: self.texels,
        }
    }

    /// Copies the stored texels of an image of the old bake.
    fn copy(&mut self, basis: Basis) -> Basis {
        let size = self.old.settings.resolution.pow(2) as usize;
        let mut copied = |image: Image| match image {
            Image::Stored(number) => {
                let at = number as usize * size;
                let new = self.texels.len() / size;
                self.texels
                    .extend_from_slice(&self.old.texels[at..at + size]);
                Image::Stored(new as u32)
            }
            other => other,
        };
        Basis {
            past_all: copied(basis.past_all),
            past_phantoms: copied(basis.past_phantoms),
        }
    }
}
