//! Calibration boards to print at true scale: PDF for printers, SVG for other programs, PNG for
//! screens. A sheet is a list of black rectangles on white paper.

pub(crate) mod pattern;

use super::intrinsics::Board;
use std::fmt::Write;
use thiserror::Error;

/// PDF points per metre.
const POINTS: f64 = 72.0 / 0.0254;
/// White margin around the pattern, as a share of a square; the detection of the outer squares
/// needs it. With half a square, the default board of 9×6 corners and 25 mm fits a sheet of A4.
const MARGIN: f64 = 0.5;
/// Height below the pattern for ruler and caption, metres.
const FOOTER: f64 = 0.010;
/// Length of the printed ruler, metres; the user measures it to check the print's scale.
const RULER: f64 = 0.1;

/// A black rectangle, in metres from the sheet's top left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Black {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// A board laid out on paper.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSheet {
    /// Width of the sheet, metres.
    pub width: f64,
    /// Height of the sheet, metres.
    pub height: f64,
    /// The black rectangles.
    pub black: Vec<Black>,
    /// Position of the caption's baseline, metres.
    pub caption_at: (f64, f64),
    /// The caption: board and instructions for printing.
    pub caption: String,
}

/// Why a board cannot be rendered.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum SheetError {
    /// The picture would be too large.
    #[error(
        "{width}×{height} pixels at {dpi} dots per inch exceed 200 Mpixel; use fewer dots per inch, or a PDF"
    )]
    TooLarge {
        /// Width, pixels.
        width: u64,
        /// Height, pixels.
        height: u64,
        /// Dots per inch.
        dpi: u32,
    },
}

impl BoardSheet {
    /// Lays out a board. The top left square of a chessboard is black, as is a ChArUco board's
    /// (OpenCV since 4.6).
    #[must_use]
    pub fn from_board(board: &Board) -> Self {
        let pattern = pattern::from_board(board);
        let margin = MARGIN * pattern.border;
        let width = pattern.width + 2.0 * margin;
        let shift = |b: &Black| Black {
            x: b.x + margin,
            y: b.y + margin,
            ..*b
        };
        let mut black: Vec<Black> = pattern.black.iter().map(shift).collect();
        // The ruler may lie in the lower margin: it crosses no edge of the pattern.
        let footer_top = pattern.height + 1.5 * margin;
        black.extend(ruler(margin, footer_top, width - 2.0 * margin));
        Self {
            width,
            height: footer_top + FOOTER,
            black,
            caption_at: (margin, footer_top + 0.65 * FOOTER),
            caption: format!(
                "Penumbra --board {board}   print at 100 %, not fitted to the page; \
                 the line above is {:.0} mm long: measure it",
                1000.0 * RULER.min(width - 2.0 * margin)
            ),
        }
    }

    /// Returns a PDF of one page of the sheet's size.
    #[must_use]
    pub fn pdf(&self) -> Vec<u8> {
        let mut drawing = String::from("0 g\n");
        let height = self.height * POINTS;
        for b in &self.black {
            let (x, y) = (b.x * POINTS, height - (b.y + b.height) * POINTS);
            let (w, h) = (b.width * POINTS, b.height * POINTS);
            let _ = writeln!(drawing, "{x:.6} {y:.6} {w:.6} {h:.6} re");
        }
        let (x, y) = (
            self.caption_at.0 * POINTS,
            height - self.caption_at.1 * POINTS,
        );
        let _ = write!(
            drawing,
            "f\nBT /F1 6 Tf {x:.3} {y:.3} Td ({}) Tj ET\n",
            self.caption
        );
        let page = format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.6} {height:.6}] /Contents 4 0 R \
             /Resources << /Font << /F1 5 0 R >> >> >>",
            self.width * POINTS
        );
        pdf_of(&[
            // Viewers that honour this do not offer to fit the page.
            "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
                .to_owned(),
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
            page,
            format!(
                "<< /Length {} >>\nstream\n{drawing}endstream",
                drawing.len()
            ),
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
        ])
    }

    /// Returns an SVG in millimetres.
    #[must_use]
    pub fn svg(&self) -> String {
        let mm = |m: f64| 1000.0 * m;
        let (w, h) = (mm(self.width), mm(self.height));
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w:.4}mm\" height=\"{h:.4}mm\" \
             viewBox=\"0 0 {w:.4} {h:.4}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
             <g shape-rendering=\"crispEdges\">\n"
        );
        for b in &self.black {
            let (x, y, w, h) = (mm(b.x), mm(b.y), mm(b.width), mm(b.height));
            let _ = writeln!(
                out,
                "<rect x=\"{x:.4}\" y=\"{y:.4}\" width=\"{w:.4}\" height=\"{h:.4}\"/>"
            );
        }
        let (x, y) = (mm(self.caption_at.0), mm(self.caption_at.1));
        let _ = writeln!(
            out,
            "</g>\n<text x=\"{x:.3}\" y=\"{y:.3}\" font-size=\"2.1\" font-family=\"sans-serif\">{}</text>\n</svg>",
            self.caption
        );
        out
    }

    /// Returns 8-bit grey pixels, width and height, without the caption.
    ///
    /// # Errors
    /// The picture would have no pixels or more than 200 Mpixel.
    pub fn raster(&self, dpi: u32) -> Result<(Vec<u8>, u32, u32), SheetError> {
        let dots = f64::from(dpi) / 0.0254;
        let (width, height) = (
            (self.width * dots).ceil() as u64,
            (self.height * dots).ceil() as u64,
        );
        if width.saturating_mul(height) > 200_000_000 || width == 0 || height == 0 {
            return Err(SheetError::TooLarge { width, height, dpi });
        }
        let (w, h) = (width as usize, height as usize);
        let mut pixels = vec![255_u8; w * h];
        for b in &self.black {
            let edge = |metres: f64, max: usize| ((metres * dots).round() as usize).min(max);
            let (left, right) = (edge(b.x, w), edge(b.x + b.width, w));
            for y in edge(b.y, h)..edge(b.y + b.height, h) {
                pixels[y * w + left..y * w + right].fill(0);
            }
        }
        Ok((pixels, width as u32, height as u32))
    }
}

/// Returns a ruler of at most `max_length` metres with ticks every 10 mm.
fn ruler(x: f64, y: f64, max_length: f64) -> Vec<Black> {
    const LINE_WIDTH: f64 = 0.0002;
    let length = RULER.min(max_length);
    let mut out = vec![Black {
        x,
        y,
        width: length,
        height: LINE_WIDTH,
    }];
    let ticks = (length / 0.01 + 1e-9) as u32;
    out.extend((0..=ticks).map(|i| Black {
        x: (x + 0.01 * f64::from(i)).min(x + length - LINE_WIDTH),
        y,
        width: LINE_WIDTH,
        height: 0.003,
    }));
    out
}

/// Returns a PDF file of `objects`; the first one is the catalogue.
fn pdf_of(objects: &[String]) -> Vec<u8> {
    let mut out = b"%PDF-1.4\n".to_vec();
    let mut offsets = Vec::new();
    for (i, object) in objects.iter().enumerate() {
        offsets.push(out.len());
        out.extend(format!("{} 0 obj\n{object}\nendobj\n", i + 1).bytes());
    }
    let table = out.len();
    let count = objects.len() + 1;
    let mut end = format!("xref\n0 {count}\n0000000000 65535 f \n");
    for offset in offsets {
        let _ = writeln!(end, "{offset:010} 00000 n ");
    }
    let _ = write!(
        end,
        "trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n"
    );
    out.extend(end.bytes());
    out
}

#[cfg(test)]
mod tests;
