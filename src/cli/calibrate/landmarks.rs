//! What stands still before the camera.

use anyhow::bail;
use penumbra_calibration::hand_eye_calibration::Landmarks;
use penumbra_calibration::intrinsics::Board;
use penumbra_fiducials::TagMap;
use penumbra_rig_model::Marker;

/// The rig's tags; none where it has none.
pub fn tags_of(markers: &[Marker]) -> anyhow::Result<Option<TagMap>> {
    if markers.is_empty() {
        return Ok(None);
    }
    let tags = markers.iter().map(Marker::tag).collect::<Result<_, _>>()?;
    Ok(Some(TagMap::new(tags)?))
}

/// A board, of the kinds that are found.
pub fn board_of(board: Board) -> anyhow::Result<Landmarks> {
    if !matches!(board, Board::Chess { .. }) {
        bail!("--board {board}: only chessboards are found in pictures yet");
    }
    Ok(Landmarks::Board(board))
}
