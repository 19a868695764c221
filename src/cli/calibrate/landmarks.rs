//! Static landmarks in front of the camera.

use anyhow::bail;
use penumbra_calibration::hand_eye_calibration::Landmarks;
use penumbra_calibration::intrinsics::Board;
use penumbra_fiducials::TagMap;
use penumbra_rig_model::Marker;

/// Returns the map of the rig's tags; `None` if it has no markers.
pub fn tag_map(markers: &[Marker]) -> anyhow::Result<Option<TagMap>> {
    if markers.is_empty() {
        return Ok(None);
    }
    let tags = markers.iter().map(Marker::tag).collect::<Result<_, _>>()?;
    Ok(Some(TagMap::new(tags)?))
}

/// Returns a board as landmarks. Only chessboards are supported.
pub fn board_landmarks(board: Board) -> anyhow::Result<Landmarks> {
    if !matches!(board, Board::Chess { .. }) {
        bail!("--board {board}: only chessboards are supported here, e.g. chess:9x6:0.025");
    }
    Ok(Landmarks::Board(board))
}
