//! Pictures composed for the instant at which they are seen.

use crate::live::{Running, status, until};
use crate::program::{Desk, desk_session};
use glam::{DQuat, DVec3};

/// Time in seconds, and a pose.
type Posed = (f64, DVec3, DQuat);

/// Reads the poses of pictures at their exposure, and as predicted for the time at which they are
/// seen.
fn poses(csv: &str) -> Vec<(Posed, Option<Posed>)> {
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let posed = |cells: &[&str], time: &str, prefix: &str| -> Option<Posed> {
        let number = |name: &str| cells[column(name)].parse::<f64>().ok();
        let of = |name: &str| number(&format!("{prefix}{name}"));
        Some((
            number(time)? * 1e-9,
            DVec3::new(of("x")?, of("y")?, of("z")?),
            DQuat::from_xyzw(of("qx")?, of("qy")?, of("qz")?, of("qw")?),
        ))
    };
    let each = lines.map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let captured = posed(&cells, "captured_ns", "").unwrap();
        (captured, posed(&cells, "shown_ns", "shown_"))
    });
    each.collect()
}

/// Returns the RMS errors (metres, radians) of the predicted poses, and of the poses at exposure,
/// against the poses of later pictures at the time at which the picture is seen.
fn pose_errors(poses: &[(Posed, Option<Posed>)]) -> [[f64; 2]; 2] {
    let mut sums = [[0.0; 2]; 2];
    let mut count = 0.0;
    for (captured, shown) in poses {
        let Some(shown) = shown else { continue };
        let pairs = poses.windows(2);
        let mut around = pairs.filter(|p| p[0].0.0 <= shown.0 && shown.0 < p[1].0.0);
        let Some([(a, _), (b, _)]) = around.next() else {
            continue;
        };
        let share = (shown.0 - a.0) / (b.0 - a.0);
        let truth = (a.1.lerp(b.1, share), a.2.slerp(b.2, share));
        for (sum, pose) in sums.iter_mut().zip([shown, captured]) {
            sum[0] += pose.1.distance_squared(truth.0);
            sum[1] += pose.2.angle_between(truth.1).powi(2);
        }
        count += 1.0;
    }
    assert!(count > 20.0, "{count}");
    sums.map(|sum| sum.map(|s: f64| (s / count).sqrt()))
}

#[test]
fn replay_predicts_the_pose_at_which_pictures_are_seen() {
    let desk = Desk::new();
    let session = desk_session().display().to_string();
    desk.put(
        "on.toml",
        "[registration]\npredict = \"display\"\ndisplay_delay_ms = 30\n",
    );
    desk.put("off.toml", "");
    let run = |name: &str| {
        desk.works(&format!(
            "replay {session} --config {name}.toml --headless --listen 127.0.0.1:0 --speed max \
             --poses-out {name}.csv --frames 40 --frames-out {name}"
        ));
        let csv = std::fs::read_to_string(desk.path(format!("{name}.csv"))).unwrap();
        poses(&csv)
    };
    let (with, without) = (run("on"), run("off"));
    assert!(without.iter().all(|(_, shown)| shown.is_none()));
    for ((captured, shown), (plain, _)) in with.iter().zip(&without) {
        assert_eq!(captured, plain);
        let ahead = shown.unwrap().0 - captured.0;
        assert!((0.0299..0.12).contains(&ahead), "{ahead}");
    }
    let [predicted, late] = pose_errors(&with);
    println!("predicted {predicted:?}, without {late:?}");
    assert!(
        (0..2).all(|k| predicted[k] < 0.5 * late[k]),
        "{predicted:?} {late:?}"
    );
    let picture = |name: &str| {
        let mut files: Vec<_> = std::fs::read_dir(desk.path(name)).unwrap().collect();
        files.sort_by_key(|f| f.as_ref().unwrap().file_name());
        std::fs::read(files[20].as_ref().unwrap().path()).unwrap()
    };
    assert_ne!(picture("on"), picture("off"));
}

/// A picture arrives 18 ms after its exposure, the matching reading of the tracker after 40 ms. A live
/// rig waits 20 ms for the reading, then composes the picture without it; the picture is seen 15 ms
/// later.
#[test]
fn display_time_includes_the_wait_for_a_late_tracker() {
    let desk = Desk::new();
    desk.works(
        "simulate session --seed 5 --seconds 3 --known-tracker --camera-latency 0 \
         --tracker-latency 0.04 --out late.mcap",
    );
    desk.put(
        "c.toml",
        "[registration]\npose = \"tracker\"\npredict = \"display\"\n[sync]\nmax_wait_ms = 20\n",
    );
    desk.works(
        "replay late.mcap --config c.toml --headless --listen 127.0.0.1:0 --speed max --poses-out p.csv",
    );
    let poses = poses(&std::fs::read_to_string(desk.path("p.csv")).unwrap());
    let shown = poses
        .iter()
        .filter_map(|(captured, shown)| Some((captured.0, shown.as_ref()?.0)));
    let ahead: Vec<f64> = shown.map(|(captured, shown)| shown - captured).collect();
    assert!(ahead.len() > 60, "{}", ahead.len());
    let (min, max) = ahead
        .iter()
        .fold((1.0_f64, 0.0_f64), |(a, b), s| (a.min(*s), b.max(*s)));
    assert!(0.051 < min && max < 0.056, "{min} to {max}");
    // The predictor adapts to the motion during the first second.
    let [predicted, late] = pose_errors(&poses[30..]);
    println!("predicted {predicted:?}, without {late:?}");
    assert!(
        (0..2).all(|k| predicted[k] < 0.5 * late[k]),
        "{predicted:?} {late:?}"
    );
}

#[test]
fn live_status_reports_the_display_prediction() {
    let desk = Desk::new();
    let session = desk_session().display().to_string();
    let devices = ["scene_camera", "environment_camera", "tracker"]
        .map(|device| format!("[{device}]\ndevice = \"replay:{session}\"\n"));
    let rest = format!(
        "[calibration]\nfrom = \"{session}\"\n[environment]\nlight_count = 8\n[registration]\npredict \
         = \"display\"\n"
    );
    desk.put("rig.toml", devices.concat() + &rest);
    let (rig, address) = Running::rig(&desk, &[]);
    until("the prediction error is reported", || {
        let display = status(&address)["registration"]["display"].clone();
        let ahead = display["ahead_ms"].as_f64().unwrap_or(0.0);
        // The measured time from arrival to window is added to the configured 15 ms.
        ahead > 15.5 && ahead < 2000.0 && display["sigma_px"].as_f64() > Some(0.0)
    });
    rig.end();
}
