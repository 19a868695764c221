//! What a user clicked on: pixels of the environment camera and what is there in the world.
//!
//! ```text
//!  # x, y of the environment camera's picture, then where that is
//!  212.5, 90.2, point, 0.30, 0.12, 0.75          metres, world
//!  402, 118, towards, 0.4, 0.2, 0.9              direction, world: sun, far lamp
//!  251, 330, scene, 410, 122, 3.20               the same thing in the scene camera's picture, at
//!                                                so many seconds from the session's start
//! ```

use glam::{DVec2, DVec3};

/// No such file is longer.
const MOST_LINES: usize = 10_000;

/// What a click is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clicked {
    /// World, metres.
    Point(DVec3),
    /// World, unit vector.
    Towards(DVec3),
    /// Pixel of the scene camera, and seconds from the session's start.
    Scene(DVec2, f64),
}

/// A click and what it is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Pixel of the environment camera.
    pub pixel: DVec2,
    /// What is there.
    pub clicked: Clicked,
}

/// A line that makes no sense.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PairError {
    /// With its number.
    #[error(
        "line {line}: `{text}`: expected `x, y, point, X, Y, Z` (metres), `x, y, towards, X, Y, Z` or `x, y, scene, U, V, SECONDS`"
    )]
    Line {
        /// From 1.
        line: usize,
        /// Its beginning.
        text: String,
    },
    /// Nothing, or far too much.
    #[error("{lines} lines: from 1 to {MOST_LINES} clicks are read")]
    Count {
        /// How many.
        lines: usize,
    },
}

/// Reads the text of such a file; `x, y, X, Y, Z` is a point.
///
/// # Errors
/// [`PairError`].
pub fn pairs(text: &str) -> Result<Vec<Pair>, PairError> {
    let mut out = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let said = line.split('#').next().unwrap_or_default().trim();
        // A head of names.
        let names = i == 0 && said.starts_with(|c: char| c.is_alphabetic());
        if said.is_empty() || names {
            continue;
        }
        let pair = pair(said).ok_or_else(|| PairError::Line {
            line: i + 1,
            text: said.chars().take(40).collect(),
        })?;
        out.push(pair);
    }
    if out.is_empty() || out.len() > MOST_LINES {
        return Err(PairError::Count { lines: out.len() });
    }
    Ok(out)
}

fn pair(line: &str) -> Option<Pair> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let number = |i: usize| fields.get(i)?.parse().ok().filter(|v: &f64| v.is_finite());
    let vector = |i: usize| Some(DVec3::new(number(i)?, number(i + 1)?, number(i + 2)?));
    let clicked = match (fields.len(), fields.get(2).copied()?) {
        (6, "point") => Clicked::Point(vector(3)?),
        (6, "towards") => Clicked::Towards(vector(3)?.try_normalize()?),
        (6, "scene") => Clicked::Scene(DVec2::new(number(3)?, number(4)?), number(5)?),
        (5, _) => Clicked::Point(vector(2)?),
        _ => return None,
    };
    Some(Pair {
        pixel: DVec2::new(number(0)?, number(1)?),
        clicked,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_form_is_read_and_a_wrong_line_is_named() {
        let text = "x,y,kind,a,b,c\n10, 20, point, 1, 2, 3 # corner\n\n1,2,3,4,5\n7,8,towards,0,0,2\n7,8,scene,100,200,1.5\n";
        let read = pairs(text).unwrap();
        let kinds: Vec<Clicked> = read.iter().map(|p| p.clicked).collect();
        assert_eq!(
            kinds,
            [
                Clicked::Point(DVec3::new(1.0, 2.0, 3.0)),
                Clicked::Point(DVec3::new(3.0, 4.0, 5.0)),
                Clicked::Towards(DVec3::Z),
                Clicked::Scene(DVec2::new(100.0, 200.0), 1.5),
            ]
        );
        for wrong in ["1,2,point,3,4", "1,2,nan,4,5", "1,2,towards,0,0,0", "1,2"] {
            let error = pairs(&format!("1,2,3,4,5\n{wrong}\n"))
                .unwrap_err()
                .to_string();
            assert!(
                error.starts_with("line 2: `1,2") && !error.contains('\n'),
                "{error}"
            );
        }
        assert!(pairs("# nothing\n").is_err());
    }
}
