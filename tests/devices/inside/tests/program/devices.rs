//! `penumbra devices`

use penumbra_guest::program::succeeds;
use penumbra_guest::rig::{ENVIRONMENT, SCENE, TRACKER, ready};
use serde_json::Value;

fn camera<'a>(cameras: &'a [Value], name: &str) -> &'a Value {
    let found = cameras
        .iter()
        .find(|camera| camera["name"].as_str().is_some_and(|n| n.contains(name)));
    found.unwrap_or_else(|| panic!("no {name} in {cameras:#?}"))
}

fn names<'a>(list: &'a Value, key: &str) -> Vec<&'a str> {
    list.as_array()
        .unwrap()
        .iter()
        .filter_map(|entry| entry[key].as_str())
        .collect()
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn lists_every_device_with_its_capabilities() {
    ready();
    let found: Value = serde_json::from_str(&succeeds(&["devices", "--json"])).unwrap();
    let cameras = found["cameras"].as_array().expect("cameras");
    // The second node of each USB camera carries metadata and is not listed.
    assert_eq!(cameras.len(), 4, "{cameras:#?}");
    let is_vivid = |camera: &&Value| camera["driver"] == "vivid";
    assert_eq!(cameras.iter().filter(is_vivid).count(), 2);

    for (name, identity, serial) in [
        ("Scene", SCENE, "SC0001"),
        ("Environment", ENVIRONMENT, "EC0001"),
    ] {
        let camera = camera(cameras, name);
        let short = identity.rsplit('/').next().unwrap();
        assert!(
            camera["identity"].as_str().unwrap().ends_with(short),
            "{camera:#}"
        );
        assert_eq!(camera["usb"]["serial"], serial);
        assert_eq!(camera["usb"]["vendor"], "1209");
        let formats = names(&camera["formats"], "fourcc");
        assert!(
            formats.contains(&"MJPG") && formats.contains(&"YUYV"),
            "{formats:?}"
        );
        let controls = names(&camera["controls"], "name");
        for control in [
            "auto_exposure",
            "exposure_time_absolute",
            "white_balance_temperature",
        ] {
            assert!(
                controls.contains(&control),
                "{name}: no {control} in {controls:?}"
            );
        }
        assert_eq!(controls.contains(&"focus_absolute"), name == "Scene");
    }
    // The serial crate defines the port's JSON; its stable name must be in it.
    let short = TRACKER.rsplit('/').next().unwrap();
    assert!(found.to_string().contains(short), "no {short} in {found:#}");
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn prints_a_readable_list() {
    ready();
    let text = succeeds(&["devices"]);
    for wanted in [
        "Scene Camera",
        "Environment Camera",
        "vivid",
        "FASTRAK",
        "exposure_time_absolute",
    ] {
        assert!(text.contains(wanted), "no {wanted} in\n{text}");
    }
}
