//! Static landmarks in front of the camera: tags or a board.

use anyhow::bail;
use penumbra_calibration::hand_eye_calibration::Landmarks;
use penumbra_calibration::intrinsics::Board;
use penumbra_fiducials::TagMap;
use penumbra_rig_model::Marker;

/// Returns the rig's tags; `None` if it has none.
pub fn tags_of(markers: &[Marker]) -> anyhow::Result<Option<TagMap>> {
    if markers.is_empty() {
        return Ok(None);
    }
    let tags = markers.iter().map(Marker::tag).collect::<Result<_, _>>()?;
    Ok(Some(TagMap::new(tags)?))
}

/// Returns the board as landmarks. Only chessboards are supported.
pub fn board_of(board: Board) -> anyhow::Result<Landmarks> {
    if !matches!(board, Board::Chess { .. }) {
        bail!("--board {board}: only chessboards are found in pictures yet");
    }
    Ok(Landmarks::Board(board))
}
