//! A home-made tracker: it sends lines of text and accepts no commands.

use penumbra_interface::RigidTransform;

/// Appends one line.
pub(crate) fn record(seconds: f64, pose: RigidTransform, out: &mut Vec<u8>) {
    let (p, q) = (pose.translation, pose.rotation);
    let text = format!(
        "1,{:.5},{:.5},{:.5},{:.6},{:.6},{:.6},{:.6},{seconds:.4}",
        p.x, p.y, p.z, q.w, q.x, q.y, q.z
    );
    let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
    out.extend(format!("{text}*{sum:02X}\r\n").bytes());
}
