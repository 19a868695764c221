//! Scenes are chosen, uploaded and saved.

use crate::{Program, browser, keep};

/// A box and a ball.
const SCENE: &str = "[[object]]\nname = \"box\"\nshape = \"box\"\nsize_m = [0.05, 0.05, 0.05]\n\
    [[object]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.03\nposition_m = [0.1, 0, 0.03]\n";

const SHOWN: &str = "document.getElementById('scene-done').textContent";
const TROUBLE: &str = "document.getElementById('scene-trouble').textContent";

/// Chooses a file and clicks *Show*.
fn show(file: &str) -> String {
    format!(
        "(() => {{ document.getElementById('scene-file').value = '{file}'; \
         document.getElementById('scene-show').click(); }})()"
    )
}

/// Chooses files in the dialogue that *Upload* opens.
fn upload(files: &[(&str, &str)]) -> String {
    let files = serde_json::json!(files);
    format!(
        "(() => {{ const all = new DataTransfer(); \
         for (const [name, text] of {files}) all.items.add(new File([text], name)); \
         const input = document.getElementById('scene-content'); input.files = all.files; \
         input.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
    )
}

#[test]
fn a_scene_is_chosen_uploaded_and_saved() {
    let Some(mut browser) = browser("a_scene_is_chosen_uploaded_and_saved") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path().join("scenes");
    std::fs::create_dir(&scenes).unwrap();
    std::fs::write(scenes.join("desk.toml"), SCENE).unwrap();
    std::fs::write(scenes.join("broken.toml"), "[[object]]\nshape = \"boks\"\n").unwrap();
    let config = folder.path().join("rig.toml");
    std::fs::write(&config, "[scene]\nfolder = \"scenes\"\nmax_upload_mb = 1\n").unwrap();
    let session = crate::SESSION;
    let config = config.to_str().unwrap();
    let (_program, address) = Program::start(&["replay", session, "--loop", "--config", config]);
    browser.resize(1280, 1000);
    browser.open(&address);
    browser.wait_for("document.body.dataset.link === 'up'");
    browser.wait_for("document.getElementById('scene-file').options.length === 4");
    browser.evaluate(&show("desk.toml"));
    browser.wait_for(&format!("{SHOWN} === 'desk.toml is shown.'"));
    browser.wait_for("document.getElementById('scene-shown').textContent === 'desk.toml'");
    browser.evaluate(&show("broken.toml"));
    browser.wait_for(&format!("{TROUBLE}.includes('boks')"));
    browser.evaluate("document.getElementById('scenes-card').scrollIntoView()");
    keep("scene-refused.png", &browser.screenshot(false));
    browser.evaluate(&upload(&[
        ("two.toml", "[[object]]\nfile = \"a.ply\"\n"),
        ("a.ply", TRIANGLE),
    ]));
    browser.wait_for(&format!(
        "{SHOWN} === 'Uploaded and checked: a.ply, two.toml.'"
    ));
    assert!(scenes.join("two.toml").is_file());
    browser.evaluate(&upload(&[("two.toml", SCENE)]));
    browser.wait_for(&format!("{TROUBLE}.includes('already')"));
    browser.evaluate(&upload(&[("large.toml", &"#".repeat(1_000_001))]));
    browser.wait_for(&format!("{TROUBLE}.includes('larger than 1 MB')"));
    // A moved object is saved where it is.
    browser.evaluate("document.getElementById('move').click()");
    browser.wait_for("document.getElementById('object').options.length === 3");
    browser.evaluate(
        "fetch('/objects', { method: 'POST', headers: { 'Content-Type': 'application/json' }, \
         body: JSON.stringify({ object: 1, offset_m: [0.1, 0.2, 0] }) }).then((r) => r.status)",
    );
    browser.evaluate("(() => { document.getElementById('scene-name').value = 'mine'; document.getElementById('scene-save').click(); })()");
    browser.wait_for(&format!(
        "{SHOWN}.startsWith('Saved. To start with it: --scene ')"
    ));
    keep("scene-saved.png", &browser.screenshot(false));
    let saved = std::fs::read_to_string(scenes.join("mine.toml")).unwrap();
    assert!(saved.contains("position_m = [0.2, 0.2, 0.03]"), "{saved}");
    let complaints = browser.complaints();
    assert!(
        complaints.iter().all(|c| c.contains("/scenes")),
        "{complaints:?}"
    );
}

/// A triangle as PLY.
const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n";
