use super::*;
use penumbra_calibration::simulation::SimulatedWebcam;
use penumbra_calibration::webcam_sheet::{FAMILY, Paper, WebcamSheet};
use penumbra_numerics::Random;

/// What the detector finds of the sheet, without rendering it: corners with the noise of detection.
fn seen(
    webcam: &SimulatedWebcam,
    map: &TagMap,
    seconds: f64,
    random: &mut Random,
) -> Vec<TagObservation> {
    let camera_from_world = webcam.pose(seconds).inverse();
    let lens = webcam.lens();
    let inside = |p: &DVec2| {
        p.min_element() > 3.0
            && p.x < f64::from(lens.width) - 3.0
            && p.y < f64::from(lens.height) - 3.0
    };
    let mut out = Vec::new();
    for tag in map.tags() {
        let corners: Vec<DVec2> = tag
            .corners()
            .iter()
            .filter_map(|c| lens.project(camera_from_world.transform_point(*c)))
            .map(|p| p + DVec2::new(random.normal(), random.normal()) * 0.1)
            .filter(inside)
            .collect();
        if let Ok(corners) = <[DVec2; 4]>::try_from(corners) {
            out.push(TagObservation {
                corners,
                ..observation(tag.id)
            });
        }
    }
    out
}

fn observation(id: u32) -> TagObservation {
    TagObservation {
        family: FAMILY,
        id,
        corners: [DVec2::ZERO; 4],
        margin: 1.0,
        wrong_bits: 0,
    }
}

#[test]
fn lens_of_a_moved_webcam_is_found_and_kept() {
    let sheet = WebcamSheet::new(Paper::A4, 100.0, 70.0, 0.0).unwrap();
    let webcam = SimulatedWebcam::of_typical_lens((640, 480), sheet, 1);
    let map = TagMap::new(sheet.tags()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(SCENE_LENS);
    let found = Arc::<Mutex<Found>>::default();
    let recorded = Arc::<RefinedLens>::default();
    let worker = Worker {
        size: (640, 480),
        collector: ViewCollector::new(NO_BOARD),
        estimated: 0,
        uncertainty: f64::INFINITY,
        file: Some(file.clone()),
        found: Arc::clone(&found),
        recorded: Arc::clone(&recorded),
    };
    let (views, waiting) = bounded(1000);
    let mut refiner = LensRefiner {
        corners: flat_corners(&map).unwrap(),
        size: (640, 480),
        last: BTreeMap::new(),
        views: Some(views),
        found,
        thread: None,
    };
    let mut random = Random::new(9);
    for i in 0..900 {
        refiner.look(&seen(&webcam, &map, f64::from(i) / 30.0, &mut random));
    }
    refiner.views = None;
    worker.run(&waiting);
    let status = refiner.status();
    println!("{status:?}");
    assert_eq!(status.source, LensSource::Refined, "{status:?}");
    let (camera, truth) = (refiner.take_lens().unwrap(), webcam.lens());
    println!("{camera:?}\n{truth:?}");
    let focal_error = (camera.focal.x / truth.focal.x - 1.0).abs();
    assert!(focal_error < 0.01, "{focal_error}");
    assert!(camera.centre.distance(truth.centre) < 6.0, "{camera:?}");
    let newest = recorded.newest().unwrap();
    assert_eq!(newest.camera, camera);
    assert_eq!(newest.file, std::fs::read_to_string(&file).unwrap());
    assert!(refiner.take_lens().is_none(), "a lens is handed over once");
    let record = LensRecord::parse(SCENE_LENS, &std::fs::read(&file).unwrap()).unwrap();
    assert_eq!(
        (record.source.as_str(), record.image_size),
        (REFINED_SOURCE, [640, 480])
    );
}

#[test]
fn moving_pictures_and_standing_tags_are_left_out() {
    let sheet = WebcamSheet::new(Paper::A4, 100.0, 70.0, 0.0).unwrap();
    let mut tags = sheet.tags();
    let (views, waiting) = bounded(1000);
    let mut refiner = LensRefiner {
        corners: flat_corners(&TagMap::new(tags.clone()).unwrap()).unwrap(),
        size: (640, 480),
        last: BTreeMap::new(),
        views: Some(views),
        found: Arc::default(),
        thread: None,
    };
    let at = |x: f64| {
        [TagObservation {
            corners: [DVec2::splat(x); 4],
            ..observation(100)
        }]
    };
    refiner.look(&at(10.0));
    refiner.look(&at(30.0));
    assert!(waiting.is_empty(), "the camera moves");
    refiner.look(&at(31.0));
    assert_eq!(waiting.len(), 1);
    tags[0].map_from_tag.translation.z = 0.01;
    assert!(flat_corners(&TagMap::new(tags).unwrap()).is_none());
}
