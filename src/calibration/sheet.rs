//! A sheet to print at true scale: black rectangles, thin rings and text on white paper. PDF for
//! printers, SVG for other programs, PNG for screens.

use std::fmt::Write;
use thiserror::Error;

/// PDF points per metre.
const POINTS: f64 = 72.0 / 0.0254;
/// Width of a thin line, metres.
pub const LINE_WIDTH: f64 = 0.0002;
/// Length of the printed ruler, metres; the user measures it to check the print's scale.
pub const RULER: f64 = 0.1;

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

/// A thin black ring, in metres from the sheet's top left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Centre, to the right.
    pub x: f64,
    /// Centre, downwards.
    pub y: f64,
    /// Radius of the line's middle.
    pub radius: f64,
}

/// A line of text. Its characters are those of ASCII, without parentheses and backslashes.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Left end of the baseline, metres from the sheet's left edge.
    pub x: f64,
    /// The baseline, metres from the sheet's top edge.
    pub y: f64,
    /// Size of the font, points.
    pub points: f64,
    /// The text.
    pub text: String,
}

/// A sheet of paper with what is printed on it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Width of the sheet, metres.
    pub width: f64,
    /// Height of the sheet, metres.
    pub height: f64,
    /// The black rectangles.
    pub black: Vec<Black>,
    /// Thin rings.
    pub rings: Vec<Ring>,
    /// Lines of text.
    pub texts: Vec<Text>,
}

/// Why a sheet cannot be rendered.
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

impl Sheet {
    /// Returns a PDF of one page of the sheet's size.
    #[must_use]
    pub fn pdf(&self) -> Vec<u8> {
        let drawing = self.pdf_drawing();
        let page = format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.6} {:.6}] /Contents 4 0 R \
             /Resources << /Font << /F1 5 0 R >> >> >>",
            self.width * POINTS,
            self.height * POINTS
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

    /// Returns the operators that draw the page.
    fn pdf_drawing(&self) -> String {
        let mut drawing = String::from("0 g\n");
        let height = self.height * POINTS;
        for b in &self.black {
            let (x, y) = (b.x * POINTS, height - (b.y + b.height) * POINTS);
            let (w, h) = (b.width * POINTS, b.height * POINTS);
            let _ = writeln!(drawing, "{x:.6} {y:.6} {w:.6} {h:.6} re");
        }
        drawing.push_str("f\n");
        if !self.rings.is_empty() {
            let _ = writeln!(drawing, "{:.4} w", LINE_WIDTH * POINTS);
        }
        for ring in &self.rings {
            let at = (ring.x * POINTS, height - ring.y * POINTS);
            drawing.push_str(&pdf_circle(at, ring.radius * POINTS));
        }
        for text in &self.texts {
            let (x, y) = (text.x * POINTS, height - text.y * POINTS);
            let _ = writeln!(
                drawing,
                "BT /F1 {} Tf {x:.3} {y:.3} Td ({}) Tj ET",
                text.points, text.text
            );
        }
        drawing
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
        out.push_str("</g>\n");
        for ring in &self.rings {
            let [x, y, r, line] = [ring.x, ring.y, ring.radius, LINE_WIDTH].map(mm);
            let _ = writeln!(
                out,
                "<circle cx=\"{x:.4}\" cy=\"{y:.4}\" r=\"{r:.4}\" fill=\"none\" stroke=\"#000\" stroke-width=\"{line}\"/>"
            );
        }
        for text in &self.texts {
            let (x, y, size) = (mm(text.x), mm(text.y), mm(text.points / POINTS));
            let _ = writeln!(
                out,
                "<text x=\"{x:.3}\" y=\"{y:.3}\" font-size=\"{size:.2}\" font-family=\"sans-serif\">{}</text>",
                text.text
            );
        }
        out.push_str("</svg>\n");
        out
    }

    /// Returns 8-bit grey pixels, width and height, without the text.
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
        for ring in &self.rings {
            draw_ring(ring, dots, (w, h), &mut pixels);
        }
        Ok((pixels, width as u32, height as u32))
    }
}

/// Draws a ring, at least a dot wide, into `pixels` of `width` and `height`; `dots` per metre.
fn draw_ring(ring: &Ring, dots: f64, (width, height): (usize, usize), pixels: &mut [u8]) {
    let steps = (std::f64::consts::TAU * ring.radius * dots * 2.0).ceil() as u32;
    for step in 0..steps {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / f64::from(steps)).sin_cos();
        let x = ((ring.x + ring.radius * cos) * dots) as usize;
        let y = ((ring.y + ring.radius * sin) * dots) as usize;
        if x < width && y < height {
            pixels[y * width + x] = 0;
        }
    }
}

/// Returns the operators that stroke a circle, of four cubic curves; points.
fn pdf_circle((x, y): (f64, f64), r: f64) -> String {
    // The curve is a circle to 0.03 %.
    let k = 0.552_285 * r;
    let quarter = |(x1, y1): (f64, f64), (x2, y2): (f64, f64), (x3, y3): (f64, f64)| {
        format!(
            "{:.4} {:.4} {:.4} {:.4} {:.4} {:.4} c\n",
            x + x1,
            y + y1,
            x + x2,
            y + y2,
            x + x3,
            y + y3
        )
    };
    [
        format!("{:.4} {y:.4} m\n", x + r),
        quarter((r, k), (k, r), (0.0, r)),
        quarter((-k, r), (-r, k), (-r, 0.0)),
        quarter((-r, -k), (-k, -r), (0.0, -r)),
        quarter((k, -r), (r, -k), (r, 0.0)),
        "S\n".to_owned(),
    ]
    .concat()
}

/// Returns a ruler of at most `max_length` metres with ticks every 10 mm.
#[must_use]
pub fn ruler(x: f64, y: f64, max_length: f64) -> Vec<Black> {
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
