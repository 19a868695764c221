//! Shadowing planes on the processor: sums of the basis images, and their light on the texels of the
//! surface cache, together with that of compact sources, which may be near. The planes of every pixel
//! would be too many look-ups for a software driver, and it executes compute shaders slowly.

use super::super::gpu_data::FrameUniform;
use super::super::shaders;
use super::super::surface_light::CachedLight;
use super::choice::Planes;
use super::normal_table::NormalTable;
use super::options::Thresholds;
use super::page_light::OpenLight;
use super::plane_sums::{FaceLights, PlaneSums};
use super::served_pages::{FrameLight, ServedPages};
use super::synthesis::PlaneWork;
use super::visible_pages::Viewer;
use super::visible_planes::VisiblePlanes;
use glam::{Vec3, Vec4};
use penumbra_interface::{RigidTransform, threads};
use penumbra_lighting::DomeLight;
use penumbra_lighting::geodesic::{FaceLight, GeodesicDome, sum_faces_into};
use penumbra_scene::planes::{Bake, Layer};
use penumbra_scene::{IndirectLight, PlaneShading};
use penumbra_surface_cache::{Bounds, ReceiverPage};
use std::sync::Arc;

/// A bake in memory, its sums, and the pages that it serves.
pub(super) struct SurfacePlanes {
    /// Directions to the faces of the dome, bake.
    faces: Vec<Vec3>,
    /// The stored images.
    images: Vec<u8>,
    /// Texels along a side of a plane.
    side: usize,
    /// Of each plane the depths that it sees; `side²` of them, or none.
    depths: Vec<Vec<u16>>,
    placed: VisiblePlanes,
    /// Planes of the real layer come first.
    planes: Vec<PlaneSums>,
    real: usize,
    /// Of each layer, for the texels of all its planes.
    shares: [Vec<Vec4>; 2],
    luminance: Vec<Vec3>,
    asum: NormalTable,
    /// What the sums were made for.
    summed_for: Option<(LightOfFaces, Thresholds)>,
    open: OpenLight,
    served: Option<ServedPages>,
    /// What the light on the pages was made for.
    written_for: Option<Written>,
    /// Number of compact sources that planes leave to the surface cache.
    left_sources: usize,
    work: PlaneWork,
}

/// Generation of a frame's light, and whether compact sources are left out of it.
type LightOfFaces = (u64, bool);

/// The light of a frame, its shading, the generation of the indirect light, and how often the
/// visibility of compact sources has changed.
type Written = (LightOfFaces, PlaneShading, u64, u64);

/// How surfaces are lit in a frame.
pub(super) struct SurfaceShading<'a> {
    pub uniform: &'a FrameUniform,
    pub lights: &'a [DomeLight],
    pub shading: PlaneShading,
    pub indirect: Option<&'a IndirectLight>,
}

impl SurfacePlanes {
    /// Takes over a bake with the lights of `dome`.
    pub fn new(bake: &Bake, dome: &GeodesicDome) -> Self {
        let faces: Vec<Vec3> = dome.faces.iter().map(|f| f.centre).collect();
        let side = bake.settings.resolution as usize;
        let asum = NormalTable::new(shaders::BY_NORMAL);
        let each = bake.planes.iter().zip(&bake.receivers);
        let each = each.zip(bake.images.chunks(bake.lights().max(1)));
        let planes: Vec<PlaneSums> = each
            .map(|((plane, receiver), basis)| {
                PlaneSums::new(plane, receiver, (basis, &faces), (side, &asum))
            })
            .collect();
        let real = bake.planes.iter().filter(|p| p.layer == Layer::Real);
        let real = real.count();
        let texels = |planes: usize| planes * side * side;
        let shares = [2 * texels(real), texels(planes.len() - real)];
        Self {
            depths: bake.receivers.iter().map(|r| r.depths.clone()).collect(),
            images: bake.texels.clone(),
            placed: VisiblePlanes::new(bake),
            shares: shares.map(|count| vec![Vec4::ZERO; count]),
            luminance: Vec::with_capacity(faces.len()),
            faces,
            side,
            planes,
            real,
            asum,
            summed_for: None,
            open: OpenLight::new(),
            served: None,
            written_for: None,
            left_sources: 0,
            work: PlaneWork::default(),
        }
    }

    /// The planes where they are now.
    pub const fn placed(&self) -> &VisiblePlanes {
        &self.placed
    }

    /// Moves the planes of the `bake`.
    pub fn place(&mut self, bake: &[penumbra_scene::planes::ShadowingPlane], by: RigidTransform) {
        self.placed.place(bake, by);
        self.served = None;
    }

    /// Bounds of the pages of real surfaces that planes serve.
    pub fn served_bounds(&self) -> &[Bounds] {
        self.served.as_ref().map_or(&[], ServedPages::bounds)
    }

    /// The work of the last frame.
    pub const fn work(&self) -> PlaneWork {
        self.work
    }

    /// Has the light of all pages written again, because other light has taken its place.
    pub fn expire(&mut self) {
        self.written_for = None;
    }

    /// Chooses the planes that serve `pages`, unless that is done.
    pub fn serve(&mut self, pages: &Arc<[ReceiverPage]>) {
        if self.served.as_ref().is_some_and(|s| s.is_of(pages)) {
            return;
        }
        let planes = Planes {
            all: &self.placed.all(),
            real: self.real,
            depths: &self.depths,
            side: self.side,
        };
        let served = ServedPages::new(&planes, pages.clone(), &self.open);
        self.planes.iter_mut().for_each(PlaneSums::forget);
        let one = self.side * self.side;
        for (is_real, look_up) in served.look_ups() {
            let first = look_up.first as usize;
            let plane = first / one + if is_real { 0 } else { self.real };
            for texel in [first, first + 1, first + self.side, first + self.side + 1] {
                self.planes[plane].need(texel % one);
            }
        }
        self.served = Some(served);
        self.summed_for = None;
        self.written_for = None;
    }

    /// Sums basis images under the light of a frame; `leaves_sources`: without compact sources.
    pub fn sum(&mut self, light: (&FaceLight, u64), leaves_sources: bool, thresholds: Thresholds) {
        let (light, generation) = light;
        self.left_sources = if leaves_sources {
            light.sources.len()
        } else {
            0
        };
        let wanted = Some(((generation, leaves_sources), thresholds));
        if self.summed_for == wanted {
            self.work = PlaneWork {
                recomputed: 0,
                images: 0,
                sources: self.left_sources,
                ..self.work
            };
            return;
        }
        self.summed_for = wanted;
        self.sum_faces(light, leaves_sources);
        let faces = self.faces.iter().copied();
        self.asum.sum(faces.zip(self.luminance.iter().copied()));
        let lights = FaceLights {
            faces: &self.faces,
            luminance: &self.luminance,
            asum: &self.asum,
        };
        let limits = thresholds.limits(self.faces.len());
        let (images, one) = (self.images.as_slice(), self.side * self.side);
        let [of_real, of_virtual] = &mut self.shares;
        let shares = of_real
            .chunks_mut(2 * one)
            .chain(of_virtual.chunks_mut(one));
        let jobs = self.planes.iter_mut().zip(shares);
        threads::for_each(jobs.collect(), |(plane, shares)| {
            plane.update(lights, limits, images, shares);
        });
        self.count_work();
        if self.work.recomputed > 0 {
            self.written_for = None;
        }
    }

    /// Sums the luminance of each face.
    fn sum_faces(&mut self, light: &FaceLight, leaves_sources: bool) {
        sum_faces_into(light, &mut self.luminance);
        self.luminance.resize(self.faces.len(), Vec3::ZERO);
        let sources = light.sources.iter().filter(|_| leaves_sources);
        for (face, irradiance) in sources.flat_map(|source| &source.irradiance_in_faces) {
            if let Some(sum) = self.luminance.get_mut(*face as usize) {
                *sum = (*sum - irradiance).max(Vec3::ZERO);
            }
        }
    }

    fn count_work(&mut self) {
        self.work = PlaneWork {
            sources: self.left_sources,
            ..PlaneWork::default()
        };
        for plane in self.planes.iter().filter(|plane| plane.serves()) {
            self.work.visible += 1;
            self.work.recomputed += usize::from(plane.job.is_due);
            self.work.images += plane.job.images;
            self.work.images_in_sight += self.faces.len();
            self.work.lights_skipped = self.work.lights_skipped.max(plane.job.skipped);
        }
    }

    /// Writes the light on surfaces that the viewer may see into the atlas of `cache`.
    pub fn write(
        &mut self,
        queue: &wgpu::Queue,
        viewer: &Viewer,
        frame: &SurfaceShading<'_>,
        cache: &CachedLight,
    ) {
        let (Some(served), Some((light, _))) = (&mut self.served, self.summed_for) else {
            return;
        };
        let apart = cache.apart();
        let indirect = frame.indirect.map_or(0, |light| light.generation);
        let renewals = apart.map_or(0, |(_, _, renewals)| renewals);
        let now = Some((light, frame.shading, indirect, renewals));
        if self.written_for != now {
            self.written_for = now;
            self.open.fill(frame.uniform, frame.lights, light.1);
            served.expire();
        }
        let light = FrameLight {
            open: &self.open,
            shares: &self.shares,
            side: self.side,
            indirect: frame.indirect,
            apart: apart.map(|(cache, lights, _)| (cache, lights)),
        };
        served.write(queue, viewer, &light, cache.atlas());
    }
}
