//! Dependencies between the crates of this workspace are the ones listed here, and run one way.

#![expect(clippy::unwrap_used)]

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// Each crate (without the prefix `penumbra-`) and the crates of this workspace on which it may
/// depend. The order is topological: a crate is below all its dependencies.
const ALLOWED: &[(&str, &[&str])] = &[
    // Devices: they depend on the interface and not on light or the rig.
    ("interface", &[]),
    ("camera-nokhwa", &["interface"]),
    ("camera-v4l2", &["interface"]),
    ("faulty", &["interface"]),
    ("replay", &["interface"]),
    ("synthetic", &["interface"]),
    ("tracker-serial", &["interface"]),
    // Independent of light and of the rig.
    ("numerics", &[]),
    ("strict-toml", &[]),
    ("picture", &["interface"]),
    ("camera", &["interface", "numerics"]),
    ("sync", &["interface", "numerics"]),
    ("session", &["interface", "tracker-serial"]),
    // Light and virtual objects.
    ("lighting", &["interface", "numerics", "picture", "camera"]),
    (
        "scene",
        &["interface", "numerics", "strict-toml", "camera", "lighting"],
    ),
    // Model of the rig, and its calibration.
    ("fiducials", &["interface", "numerics", "picture", "camera"]),
    (
        "white-balance",
        &[
            "interface",
            "numerics",
            "picture",
            "camera",
            "lighting",
            "scene",
        ],
    ),
    (
        "rig-model",
        &[
            "interface",
            "numerics",
            "camera",
            "scene",
            "fiducials",
            "white-balance",
        ],
    ),
    (
        "calibration",
        &[
            "interface",
            "numerics",
            "picture",
            "camera",
            "sync",
            "lighting",
            "scene",
            "fiducials",
            "white-balance",
            "rig-model",
        ],
    ),
    (
        "registration",
        &["interface", "numerics", "camera", "fiducials"],
    ),
    // Pictures, settings, devices in use, outputs.
    ("surface-cache", &["interface", "lighting", "scene"]),
    (
        "compositor",
        &[
            "interface",
            "numerics",
            "picture",
            "camera",
            "lighting",
            "scene",
            "surface-cache",
        ],
    ),
    (
        "config",
        &[
            "interface",
            "tracker-serial",
            "strict-toml",
            "picture",
            "camera",
            "sync",
            "lighting",
            "scene",
            "fiducials",
            "white-balance",
            "rig-model",
        ],
    ),
    (
        "capture",
        &[
            "interface",
            "camera-nokhwa",
            "camera-v4l2",
            "replay",
            "tracker-serial",
            "session",
            "config",
        ],
    ),
    ("output", &["interface", "picture", "compositor", "config"]),
    (
        "status",
        &[
            "interface",
            "picture",
            "camera",
            "lighting",
            "scene",
            "config",
        ],
    ),
    // Photographs without a rig.
    (
        "photo",
        &[
            "interface",
            "numerics",
            "picture",
            "camera",
            "session",
            "lighting",
            "fiducials",
            "calibration",
        ],
    ),
    ("photo-page", &["picture", "lighting", "photo", "status"]),
    // Connects everything.
    (
        "rig",
        &[
            "interface",
            "synthetic",
            "tracker-serial",
            "numerics",
            "picture",
            "camera",
            "sync",
            "session",
            "lighting",
            "scene",
            "fiducials",
            "white-balance",
            "rig-model",
            "calibration",
            "registration",
            "compositor",
            "config",
            "capture",
            "output",
            "status",
        ],
    ),
    (
        "penumbra",
        &[
            "interface",
            "synthetic",
            "tracker-serial",
            "picture",
            "camera",
            "session",
            "lighting",
            "scene",
            "fiducials",
            "photo",
            "photo-page",
            "rig-model",
            "calibration",
            "compositor",
            "config",
            "capture",
            "output",
            "status",
            "rig",
        ],
    ),
    // Test support.
    ("test-data", &[]),
    ("usbcam", &[]),
    ("guest", &["usbcam"]),
];

/// Crates that the tests, examples and benchmarks of a crate may use beyond its dependencies.
/// `test-data` is open to all.
const ALLOWED_IN_TESTS: &[(&str, &[&str])] = &[
    ("tracker-serial", &["synthetic"]),
    // The simulated tracker of the pairing tests needs a protocol.
    ("sync", &["tracker-serial"]),
    ("session", &["sync"]),
    ("capture", &["faulty"]),
    ("rig", &["faulty"]),
    ("penumbra", &["faulty", "sync", "white-balance"]),
    ("guest", &["interface", "synthetic", "tracker-serial"]),
];

type Graph = BTreeMap<String, BTreeSet<String>>;

fn short(name: &str) -> String {
    name.strip_prefix("penumbra-").unwrap_or(name).to_owned()
}

fn from_list(list: &[(&str, &[&str])]) -> Graph {
    let owned = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
    list.iter()
        .map(|(name, names)| ((*name).to_owned(), owned(names)))
        .collect()
}

/// The graphs of normal and build dependencies and of those of tests alone, from `cargo metadata`.
fn from_cargo() -> (Graph, Graph) {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--no-deps",
            "--offline",
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo metadata: {error}");
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let name = |v: &Value| short(v["name"].as_str().unwrap());
    let members: BTreeSet<String> = packages.iter().map(name).collect();
    let dependencies = |package: &Value, of_tests: bool| -> BTreeSet<String> {
        let all = package["dependencies"].as_array().unwrap().iter();
        all.filter(|d| (d["kind"] == "dev") == of_tests)
            .map(name)
            .filter(|n| members.contains(n))
            .collect()
    };
    let normal: Graph = packages
        .iter()
        .map(|p| (name(p), dependencies(p, false)))
        .collect();
    let of_tests = packages
        .iter()
        .map(|p| {
            let mut used = dependencies(p, true);
            // A crate may use itself with a feature that only its tests need.
            let is_new = |n: &String| *n != name(p) && !normal[&name(p)].contains(n);
            used.retain(|n| is_new(n) && n != "test-data");
            (name(p), used)
        })
        .filter(|(_, used)| !used.is_empty())
        .collect();
    (normal, of_tests)
}

/// One line for each difference between the dependencies in use and the list `list`.
fn differences(used: &Graph, allowed: &Graph, list: &str) -> Vec<String> {
    let none = BTreeSet::new();
    let names: BTreeSet<&String> = used.keys().chain(allowed.keys()).collect();
    let mut lines = Vec::new();
    for name in names {
        let (uses, may) = (
            used.get(name).unwrap_or(&none),
            allowed.get(name).unwrap_or(&none),
        );
        lines.extend(uses.difference(may).map(|d| {
            format!("{name} depends on {d}, which {list} does not allow: remove the dependency")
        }));
        lines.extend(may.difference(uses).map(|d| {
            format!("{name} does not depend on {d}: remove it from {list} in tests/crates.rs")
        }));
    }
    lines
}

/// One line for each entry of the list that is above one of its dependencies.
fn out_of_order(list: &[(&str, &[&str])]) -> Vec<String> {
    let mut above = BTreeSet::new();
    let mut lines = Vec::new();
    for (name, dependencies) in list {
        let below = dependencies.iter().filter(|d| !above.contains(*d));
        lines.extend(below.map(|d| format!("{name} must be below {d} in ALLOWED")));
        if !above.insert(name) {
            lines.push(format!("{name} is in ALLOWED twice"));
        }
    }
    lines
}

/// The crates in a cycle or depending on one: those that remain when crates without remaining
/// dependencies are removed repeatedly (Kahn 1962).
fn cyclic(graph: &Graph) -> BTreeSet<String> {
    let mut left = graph.clone();
    loop {
        let is_free = |d: &String| !left.contains_key(d);
        let free: Vec<String> = left
            .iter()
            .filter(|(_, dependencies)| dependencies.iter().all(is_free))
            .map(|(name, _)| name.clone())
            .collect();
        if free.is_empty() {
            return left.into_keys().collect();
        }
        left.retain(|name, _| !free.contains(name));
    }
}

#[test]
fn crates_depend_only_on_what_is_allowed() {
    let (normal, of_tests) = from_cargo();
    let mut lines = differences(&normal, &from_list(ALLOWED), "ALLOWED");
    lines.extend(differences(
        &of_tests,
        &from_list(ALLOWED_IN_TESTS),
        "ALLOWED_IN_TESTS",
    ));
    let listed: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    let missing = normal.keys().filter(|n| !listed.contains(n.as_str()));
    lines
        .extend(missing.map(|n| format!("{n} is missing from ALLOWED: add it in tests/crates.rs")));
    let removed = listed.iter().filter(|n| !normal.contains_key(**n));
    lines.extend(
        removed.map(|n| format!("{n} is no crate: remove it from ALLOWED in tests/crates.rs")),
    );
    assert!(lines.is_empty(), "\n{}", lines.join("\n"));
}

#[test]
fn dependencies_run_one_way() {
    let (normal, _) = from_cargo();
    let cycle = cyclic(&normal);
    assert!(cycle.is_empty(), "crates in or above a cycle: {cycle:?}");
    let lines = out_of_order(ALLOWED);
    assert!(lines.is_empty(), "\n{}", lines.join("\n"));
}

#[test]
fn forbidden_unused_misplaced_and_cyclic_dependencies_are_reported() {
    let list: &[(&str, &[&str])] = &[("a", &["b"]), ("b", &[]), ("c", &[])];
    assert_eq!(out_of_order(list), ["a must be below b in ALLOWED"]);
    let used = from_list(&[("a", &[]), ("b", &["c"]), ("c", &[])]);
    assert_eq!(
        differences(&used, &from_list(list), "ALLOWED"),
        [
            "a does not depend on b: remove it from ALLOWED in tests/crates.rs",
            "b depends on c, which ALLOWED does not allow: remove the dependency",
        ]
    );
    let ring = from_list(&[("a", &["b"]), ("b", &["a"]), ("c", &[])]);
    assert_eq!(cyclic(&ring).len(), 2);
    assert!(cyclic(&used).is_empty());
}
