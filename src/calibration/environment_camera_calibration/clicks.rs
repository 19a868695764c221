//! The user's clicks: pixels of the environment camera and the corresponding points or directions.
//!
//! ```text
//!  # x, y of the environment camera's picture, then the point or direction
//!  212.5, 90.2, point, 0.30, 0.12, 0.75          position, world, metres
//!  402, 118, towards, 0.4, 0.2, 0.9              direction, world: sun, distant lamp
//!  251, 330, scene, 410, 122, 3.20               pixel of the same point in the scene camera's
//!                                                picture, seconds from the session's start
//! ```

use glam::{DVec2, DVec3};

/// Maximum number of clicks in a file.
const MAX_LINES: usize = 10_000;

/// The point or direction that was clicked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClickTarget {
    /// Position, world, metres.
    Point(DVec3),
    /// Direction, world, unit vector.
    Towards(DVec3),
    /// Pixel of the scene camera, and seconds from the session's start.
    Scene(DVec2, f64),
}

/// A click and its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Click {
    /// Pixel of the environment camera.
    pub pixel: DVec2,
    /// The target.
    pub target: ClickTarget,
}

/// Why a file of clicks could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ClickError {
    /// A line is malformed.
    #[error(
        "line {line}: `{text}`: expected `x, y, point, X, Y, Z` (metres), `x, y, towards, X, Y, Z` or `x, y, scene, U, V, SECONDS`"
    )]
    Line {
        /// Line number, from 1.
        line: usize,
        /// Beginning of the line.
        text: String,
    },
    /// There are no clicks or too many.
    #[error("{lines} clicks; expected 1 to {MAX_LINES}")]
    Count {
        /// Number of clicks.
        lines: usize,
    },
}

/// Parses a file of clicks (see the module's documentation); `x, y, X, Y, Z` is a point.
///
/// # Errors
/// A line is malformed, or there are no clicks or more than 10 000.
pub fn parse_clicks(text: &str) -> Result<Vec<Click>, ClickError> {
    let mut out = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default().trim();
        let is_header = i == 0 && content.starts_with(|c: char| c.is_alphabetic());
        if content.is_empty() || is_header {
            continue;
        }
        let pair = pair(content).ok_or_else(|| ClickError::Line {
            line: i + 1,
            text: content.chars().take(40).collect(),
        })?;
        out.push(pair);
    }
    if out.is_empty() || out.len() > MAX_LINES {
        return Err(ClickError::Count { lines: out.len() });
    }
    Ok(out)
}

fn pair(line: &str) -> Option<Click> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let number = |i: usize| fields.get(i)?.parse().ok().filter(|v: &f64| v.is_finite());
    let vector = |i: usize| Some(DVec3::new(number(i)?, number(i + 1)?, number(i + 2)?));
    let clicked = match (fields.len(), fields.get(2).copied()?) {
        (6, "point") => ClickTarget::Point(vector(3)?),
        (6, "towards") => ClickTarget::Towards(vector(3)?.try_normalize()?),
        (6, "scene") => ClickTarget::Scene(DVec2::new(number(3)?, number(4)?), number(5)?),
        (5, _) => ClickTarget::Point(vector(2)?),
        _ => return None,
    };
    Some(Click {
        pixel: DVec2::new(number(0)?, number(1)?),
        target: clicked,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_form_and_names_malformed_lines() {
        let text = "x,y,kind,a,b,c\n10, 20, point, 1, 2, 3 # corner\n\n1,2,3,4,5\n7,8,towards,0,0,2\n7,8,scene,100,200,1.5\n";
        let read = parse_clicks(text).unwrap();
        let kinds: Vec<ClickTarget> = read.iter().map(|p| p.target).collect();
        assert_eq!(
            kinds,
            [
                ClickTarget::Point(DVec3::new(1.0, 2.0, 3.0)),
                ClickTarget::Point(DVec3::new(3.0, 4.0, 5.0)),
                ClickTarget::Towards(DVec3::Z),
                ClickTarget::Scene(DVec2::new(100.0, 200.0), 1.5),
            ]
        );
        for wrong in ["1,2,point,3,4", "1,2,nan,4,5", "1,2,towards,0,0,0", "1,2"] {
            let error = parse_clicks(&format!("1,2,3,4,5\n{wrong}\n"))
                .unwrap_err()
                .to_string();
            assert!(
                error.starts_with("line 2: `1,2") && !error.contains('\n'),
                "{error}"
            );
        }
        assert!(parse_clicks("# nothing\n").is_err());
    }
}
