use super::*;
use std::os::unix::fs::symlink;
use tempfile::TempDir;

/// A machine with two USB cameras of the same model (two nodes each) and one camera on a
/// platform bus.
fn machine() -> (TempDir, SystemRoots) {
    let root = tempfile::tempdir().unwrap();
    let roots = SystemRoots {
        dev: root.path().join("dev"),
        sys: root.path().join("sys"),
    };
    fs::create_dir_all(roots.dev.join("v4l/by-id")).unwrap();
    fs::create_dir_all(roots.dev.join("v4l/by-path")).unwrap();
    for (usb, first, serial) in [("1-1", 0, "AAA:1"), ("1-2", 2, "BBB")] {
        let device = roots.sys.join("devices/usb1").join(usb);
        fs::create_dir_all(device.join("iface")).unwrap();
        fs::write(device.join("idVendor"), "046d\n").unwrap();
        fs::write(device.join("idProduct"), "0825\n").unwrap();
        fs::write(device.join("serial"), format!("{serial}\n")).unwrap();
        for index in 0..2 {
            let node = format!("video{}", first + index);
            add_node(&roots, &node, index, &device.join("iface"));
            link(
                &roots,
                "by-path",
                &format!("pci-usb-{usb}-video-index{index}"),
                &node,
            );
        }
    }
    link(
        &roots,
        "by-id",
        "usb-046d_C270_AAA:1-video-index0",
        "video0",
    );
    link(
        &roots,
        "by-id",
        "usb-046d_C270_AAA:1-video-index1",
        "video1",
    );
    let platform = roots.sys.join("devices/platform/vivid.0");
    fs::create_dir_all(&platform).unwrap();
    add_node(&roots, "video10", 0, &platform);
    (root, roots)
}

fn add_node(roots: &SystemRoots, node: &str, index: u32, device: &Path) {
    fs::write(roots.dev.join(node), "").unwrap();
    let class = roots.sys.join("class/video4linux").join(node);
    fs::create_dir_all(&class).unwrap();
    fs::write(class.join("index"), format!("{index}\n")).unwrap();
    fs::write(class.join("name"), format!("Camera {node}\n")).unwrap();
    symlink(device, class.join("device")).unwrap();
}

fn link(roots: &SystemRoots, kind: &str, name: &str, node: &str) {
    symlink(
        format!("../../{node}"),
        roots.dev.join("v4l").join(kind).join(name),
    )
    .unwrap();
}

fn probe(node: &Path) -> Option<Capabilities> {
    let is_platform = node.ends_with("video10");
    Some(Capabilities {
        bus: if is_platform {
            "platform:vivid-000"
        } else {
            "usb-0"
        }
        .into(),
        captures: true,
        ..Capabilities::default()
    })
}

fn node(device: &str, roots: &SystemRoots) -> Result<String, DeviceError> {
    let node = resolve(device, roots, probe)?;
    Ok(node
        .path
        .file_name()
        .unwrap()
        .to_string_lossy()
        .into_owned())
}

#[test]
fn every_identity_finds_its_camera_again() {
    let (_root, roots) = machine();
    let nodes = all(&roots);
    assert_eq!(nodes.len(), 5);
    for node in nodes.iter().filter(|node| node.index == 0) {
        let bus = probe(&node.path).unwrap().bus;
        let identity = node.identity(Some(&bus));
        let found = resolve(&identity, &roots, probe).unwrap();
        assert_eq!(&found, node, "{identity}");
        assert!(!identity.contains("/dev/"), "{identity}");
    }
}

#[test]
fn identities_prefer_durable_names() {
    let (_root, roots) = machine();
    let identities: Vec<String> = all(&roots).iter().map(|p| p.identity(Some("b"))).collect();
    assert_eq!(identities[0], "usb-046d_C270_AAA:1-video-index0");
    assert_eq!(identities[2], "usb:046d:0825:BBB");
    assert_eq!(identities[4], "bus:b");
}

#[test]
fn a_camera_can_be_named_in_several_ways() {
    let (_root, roots) = machine();
    for (device, expected) in [
        ("usb-046d_C270_AAA:1-video-index0", "video0"),
        ("usb-046d_C270_AAA:1", "video0"),
        ("pci-usb-1-2", "video2"),
        ("pci-usb-1-2-video-index0", "video2"),
        ("usb:046D:0825:AAA:1", "video0"),
        ("usb:046d:0825:BBB", "video2"),
        ("bus:platform:vivid-000", "video10"),
    ] {
        assert_eq!(node(device, &roots).unwrap(), expected, "{device}");
    }
    let by_link = roots.dev.join("v4l/by-path/pci-usb-1-2-video-index0");
    assert_eq!(node(by_link.to_str().unwrap(), &roots).unwrap(), "video2");
}

/// Both cameras were unplugged and plugged in again and have changed their numbers, and udev has
/// not updated its links yet.
#[test]
fn a_link_to_another_camera_is_ignored() {
    let (_root, roots) = machine();
    let serial = |usb: &str, serial: &str| {
        let device = roots.sys.join("devices/usb1").join(usb);
        fs::write(device.join("serial"), serial).unwrap();
    };
    serial("1-1", "BBB\n");
    serial("1-2", "AAA:1\n");
    let link = roots.dev.join("v4l/by-id/usb-046d_C270_AAA:1-video-index0");
    for device in ["usb-046d_C270_AAA:1", link.to_str().unwrap()] {
        let error = node(device, &roots).unwrap_err();
        assert!(matches!(error, DeviceError::NotFound { .. }), "{error}");
    }
    assert_eq!(node("usb:046d:0825:AAA:1", &roots).unwrap(), "video2");
    assert_eq!(all(&roots)[0].by_id, None);
    // udev replaces odd characters, or omits such a number from the name.
    for written in ["AAA 1\n", "A-A.A_1\n", "AAA,2\n", "Sériennummer\n"] {
        serial("1-1", written);
        assert_eq!(
            node("usb-046d_C270_AAA:1", &roots).unwrap(),
            "video0",
            "{written}"
        );
    }
}

#[test]
fn several_matching_cameras_are_listed() {
    let (_root, roots) = machine();
    for device in ["usb:046d:0825", ""] {
        let error = node(device, &roots).unwrap_err().to_string();
        assert!(
            error.contains("pci-usb-1-1-video-index0, pci-usb-1-2-video-index0"),
            "{error}"
        );
    }
}

#[test]
fn missing_cameras_and_malformed_names_are_errors() {
    let (_root, roots) = machine();
    for device in [
        "usb:046d:9999",
        "usb-046d_C270_CCC",
        "/dev/none",
        "bus:pci",
        "usb:046d:0825:C",
    ] {
        let error = node(device, &roots).unwrap_err();
        assert!(
            matches!(error, DeviceError::NotFound { .. }),
            "{device}: {error}"
        );
    }
    for device in ["usb:46d:825", "usb:", "usb:046d", "usb:046d:082z"] {
        let error = node(device, &roots).unwrap_err().to_string();
        assert!(error.contains("lsusb"), "{device}: {error}");
    }
}

#[test]
fn a_machine_without_cameras_or_sysfs_has_no_cameras() {
    let root = tempfile::tempdir().unwrap();
    let roots = SystemRoots {
        dev: root.path().join("dev"),
        sys: root.path().join("sys"),
    };
    assert!(all(&roots).is_empty());
    let error = node("", &roots).unwrap_err().to_string();
    assert_eq!(
        error,
        "any camera: not connected; plug it in or configure another one"
    );
}

#[test]
fn the_identity_leads_to_product_name_and_serial_number() {
    let (_root, roots) = machine();
    let known = |identity: &str| name_and_serial_in(identity, &roots);
    let first = known("usb-046d_C270_AAA:1-video-index0");
    assert_eq!(first, Some(("Camera video0".into(), Some("AAA:1".into()))));
    let second = known("usb:046d:0825:BBB");
    assert_eq!(second, Some(("Camera video2".into(), Some("BBB".into()))));
    assert_eq!(known("/dev/nowhere"), None);
}
