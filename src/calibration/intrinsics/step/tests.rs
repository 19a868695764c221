use super::*;
use crate::intrinsics::estimate::tests::{pinhole, poses_of};
use crate::intrinsics::synthetic::BoardRenderer;
use crate::step::PictureInput;
use penumbra_camera::LensModel;
use penumbra_interface::MonotonicTime;

const OPTIONS: Options = Options {
    model: LensModel::Brown,
    square_pixels: true,
};

fn step(board: &str) -> IntrinsicsStep {
    let board = Board::parse(board).unwrap();
    IntrinsicsStep::new(CameraRole::Scene, board, OPTIONS, KnownLenses::default())
}

fn picture(grey: &Grey) -> Picture {
    let rgba = grey.data.iter().flat_map(|v| {
        let code = *v as u8;
        [code, code, code, 255]
    });
    Picture {
        width: grey.width as u32,
        height: grey.height as u32,
        rgba: rgba.collect(),
    }
}

fn made() -> CalibrationProvenance {
    CalibrationProvenance {
        date: "2026-01-02T03:04:05Z".to_owned(),
        source: "a.mcap".to_owned(),
        device: Some("webcam".to_owned()),
        serial: Some("A1".to_owned()),
    }
}

/// The board is partly outside some pictures.
#[test]
fn rendered_charuco_pictures_give_hints_and_lens() {
    let lens = pinhole();
    let board = Board::parse("charuco:9x6:0.03:0.022:5x5_50").unwrap();
    let renderer = BoardRenderer::new(&lens);
    let poses = poses_of(&board, 16, (0.4, 0.25), 5);
    let mut step = step("charuco:9x6:0.03:0.022:5x5_50");
    assert!(step.inputs().scene && !step.inputs().environment && !step.inputs().poses);
    let mut hints = Vec::new();
    for (i, pose) in poses.iter().enumerate() {
        let picture = picture(&renderer.render(&board, *pose, 0.6, 1.0));
        step.observe(&StepInput::Picture(PictureInput {
            camera: CameraRole::Scene,
            picture: &picture,
            captured_at: MonotonicTime::from_nanos(0),
            bracket_ev: 0.0,
            exposure: None,
            seconds: i as f64,
        }));
        let progress = step.progress();
        assert!(
            !progress.overlay_points.is_empty() && progress.camera == Some(CameraRole::Scene),
            "{i}"
        );
        hints.push(progress.hint);
    }
    assert!(
        hints[0].contains("tilted") && hints.iter().any(|h| h.contains("cover the")),
        "{hints:?}"
    );
    assert!(step.progress().share > 0.8, "{:?}", step.progress());
    let corners = step.corners();
    let (header, first) = corners.split_once('\n').unwrap();
    assert!(
        header.starts_with("view,board_x_m") && first.starts_with("0.00 s,0.0"),
        "{first}"
    );
    let found = step.finish(&made());
    assert_ne!(found.grade, Grade::Refused, "{:?}", found.findings);
    let record = LensRecord::parse("a", found.file.unwrap().as_bytes()).unwrap();
    let deviation = (record.focal[0] / lens.focal.x - 1.0).abs();
    assert!(deviation < 0.005, "{:?} {}", record.focal, lens.focal);
    assert_eq!(record.device.unwrap().serial.as_deref(), Some("A1"));
    assert!(found.report.contains("Lens of the scene camera") && found.report.contains("Next: "));
}

#[test]
fn recording_without_board_is_refused() {
    let mut step = step("charuco:9x6:0.03:0.022");
    assert_eq!(step.progress().share, 0.0);
    let black = picture(&Grey::from_bytes(640, 480, &[]));
    step.add_picture("1", &black);
    assert!(step.progress().hint.starts_with("show the complete board"));
    let found = step.finish(&made());
    assert_eq!((found.grade, found.file), (Grade::Refused, None));
    assert!(
        found.findings[0].1.contains("none of 1 pictures"),
        "{:?}",
        found.findings
    );
}
