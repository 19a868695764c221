//! Problems of single pictures of a recording, for the report: damaged or of a wrong size.

use serde::Serialize;

/// Maximum number of different problems that are listed.
const MAX_LISTED: usize = 64;

/// A problem that one or more pictures have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PictureProblem {
    /// What is wrong, and what to do.
    pub description: String,
    /// Number of pictures of the scene camera that have it.
    pub pictures: u64,
    /// Time of the first, seconds since the first picture.
    pub first_seconds: f64,
    /// Time of the last.
    pub last_seconds: f64,
}

/// The problems so far.
#[derive(Clone, Debug, Default)]
pub(super) struct PictureProblems(Vec<PictureProblem>);

impl PictureProblems {
    /// Adds a problem of the picture at `seconds`; a known one is counted.
    pub fn add(&mut self, description: &str, seconds: f64) {
        let known = self.0.iter_mut().find(|p| p.description == description);
        if let Some(problem) = known {
            problem.pictures += 1;
            problem.last_seconds = seconds;
        } else if self.0.len() < MAX_LISTED {
            self.0.push(PictureProblem {
                description: description.to_owned(),
                pictures: 1,
                first_seconds: seconds,
                last_seconds: seconds,
            });
        }
    }

    /// Returns the first problem; empty without one.
    pub fn first(&self) -> &str {
        self.0.first().map_or("", |problem| &problem.description)
    }

    /// Returns the problems in the order of their first pictures.
    pub fn into_list(self) -> Vec<PictureProblem> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_problem_is_counted() {
        let mut problems = PictureProblems::default();
        for (text, seconds) in [("a", 0.5), ("b", 1.0), ("a", 2.0)] {
            problems.add(text, seconds);
        }
        assert_eq!(problems.first(), "a");
        let list = problems.into_list();
        assert_eq!(list.len(), 2);
        assert_eq!((list[0].pictures, list[1].pictures), (2, 1));
        assert_eq!((list[0].first_seconds, list[0].last_seconds), (0.5, 2.0));
    }
}
