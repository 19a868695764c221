use crate::feed::Feed;
use crate::light::estimator::LightEstimator;
use crate::light::view::{SceneView, SphereAt};
use crate::setup::RigSetup;
use crate::source::Source;
use bytes::Bytes;
use glam::{DVec2, Vec3};
use penumbra_camera::EnvironmentView;
use penumbra_capture::Next;
use penumbra_config::Config;
use penumbra_interface::PixelFormat;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_picture::{Picture, decode_within};
use penumbra_session::Session;
use penumbra_sync::EnvironmentSet;
use std::path::Path;

/// Angle between what is painted out and a lamp, radians.
const AROUND: f64 = 0.3;

/// A recorded rig, with its light as it was after each picture of the environment.
struct Recorded {
    setup: RigSetup,
    source: Source,
    config: Config,
}

impl Recorded {
    fn desk() -> Self {
        let desk =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/sessions/desk.mcap");
        let source = Source::Recorded(Session::open(&desk).unwrap());
        let config = Config::default();
        let setup = RigSetup::read(&source, &config).unwrap();
        Self {
            setup,
            source,
            config,
        }
    }

    /// The sources after each of `count` pictures of the environment, from which `change` takes something.
    fn sources(
        &self,
        count: usize,
        change: impl Fn(usize, &EnvironmentSet) -> EnvironmentSet,
    ) -> Vec<Vec<CompactSource>> {
        let Source::Recorded(session) = &self.source else {
            unreachable!("it is recorded");
        };
        let files = |name: &str| session.attachment(name);
        let mut light =
            LightEstimator::without_indirect_light(&self.setup, &self.config, &files).unwrap();
        let pairing = crate::settings::pairing_config(&self.setup.calibration).with_full_windows();
        let mut feed = Feed::new(&self.source, &self.setup.calibration, pairing, false);
        let (mut picture, mut all, mut newest) = (Picture::default(), Vec::new(), 0);
        while let Next::Item(item) = feed.next_picture(None) {
            let frame = item.frame;
            let yuv = self.config.input.encoding();
            decode_within(
                self.setup.max_scene_pixels(),
                &frame.scene,
                &yuv,
                &mut picture,
            )
            .unwrap();
            let view = SceneView {
                sphere: SphereAt::Calibrated,
                picture: &picture,
                world_from_camera: self.setup.world_from_camera(&frame),
                camera: &self.setup.calibration.scene_camera.camera,
                captured_at: frame.captured_at,
                exposure: frame.scene.exposure,
            };
            let Some(set) = frame.environment.as_ref().map(|e| e.set.as_ref()) else {
                continue;
            };
            if set.generation == newest {
                continue;
            }
            newest = set.generation;
            light.update(Some(&change(all.len(), set)), &view).unwrap();
            all.push(light.state().sources.to_vec());
            if all.len() == count {
                break;
            }
        }
        all
    }

    /// The set with everything around a direction as dark as a black coat.
    fn painted_out(&self, set: &EnvironmentSet, direction: Vec3) -> EnvironmentSet {
        let environment = self.setup.calibration.environment.as_ref().unwrap();
        let EnvironmentView::Fisheye {
            lens,
            world_from_camera,
        } = &environment.view
        else {
            panic!("the desk has a fisheye");
        };
        let mut set = set.clone();
        for frame in &mut set.frames {
            let mut picture = Picture::default();
            let yuv = self.config.input.encoding();
            decode_within(u64::MAX, frame, &yuv, &mut picture).unwrap();
            let mut rgb = Vec::new();
            for y in 0..picture.height {
                for x in 0..picture.width {
                    let ray = lens.unproject(DVec2::new(f64::from(x), f64::from(y)));
                    let towards = ray.map(|ray| world_from_camera.rotation * ray);
                    let is_near = |d: glam::DVec3| d.angle_between(direction.as_dvec3()) < AROUND;
                    let is_hidden = towards.is_some_and(is_near);
                    let shown = picture.rgb(x, y);
                    rgb.extend(if is_hidden { [12; 3] } else { shown });
                }
            }
            frame.data = Bytes::from(rgb);
            frame.format = PixelFormat::Rgb8;
            (frame.width, frame.height, frame.stride) = (picture.width, picture.height, 0);
        }
        set
    }
}

#[test]
fn lamp_that_something_hides_keeps_its_place_and_its_light() {
    let desk = Recorded::desk();
    let seen = desk.sources(1, |_, set| set.clone())[0][0];
    assert!(seen.position.is_some() && !seen.is_unseen, "{seen:?}");
    // Hidden in the first pictures and in the last, in view in between.
    let is_hidden = |number: usize| !(2..4).contains(&number);
    let sources = desk.sources(6, |number, set| {
        if is_hidden(number) {
            desk.painted_out(set, seen.direction)
        } else {
            set.clone()
        }
    });
    let place = seen.position.unwrap();
    for (number, sources) in sources.iter().enumerate() {
        let unseen = sources.iter().filter(|s| s.is_unseen).count();
        assert_eq!(unseen, usize::from(is_hidden(number)), "{sources:?}");
        let lamp = sources[0];
        let at = lamp.position.expect("near");
        assert!(at.distance(place) < 0.1, "{number}: {at} {place}");
        let light = lamp.irradiance.element_sum() / seen.irradiance.element_sum();
        assert!((light - 1.0).abs() < 0.15, "{number}: {light}");
    }
}
