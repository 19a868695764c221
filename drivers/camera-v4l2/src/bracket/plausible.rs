//! Whether a frame looks like the exposure that it is said to have.

/// Frames in a row that look like another step's: the cycle has slipped.
const SLIPPED: u32 = 8;
/// How much of a new frame goes into its step's level.
const LEARNING: f64 = 0.3;
/// Stops by which levels must differ to be told apart.
const LEAST_STEP: f64 = 0.3;

/// What a frame's brightness says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Fits,
    /// It looks like another step: not to be trusted.
    Doubtful,
    /// So have many in a row: measure the lag anew.
    Slipped,
}

/// Knows how bright each step's pictures are.
#[derive(Clone, Debug, Default)]
pub(crate) struct Plausibility {
    levels: Vec<Option<f64>>,
    doubtful: u32,
}

impl Plausibility {
    pub(crate) fn new(steps: usize) -> Self {
        Self {
            levels: vec![None; steps],
            doubtful: 0,
        }
    }

    /// Judges a frame of `step` by its brightness in stops.
    pub(crate) fn judge(&mut self, step: usize, stops: f64) -> Verdict {
        let Some(own) = self.levels.get(step).copied().flatten() else {
            if let Some(level) = self.levels.get_mut(step) {
                *level = Some(stops);
            }
            return Verdict::Fits;
        };
        let is_other = |level: f64| {
            (level - own).abs() > LEAST_STEP
                && (stops - own).abs() > LEAST_STEP + 2.0 * (stops - level).abs()
        };
        if self.levels.iter().flatten().any(|level| is_other(*level)) {
            self.doubtful += 1;
            return if self.doubtful >= SLIPPED {
                Verdict::Slipped
            } else {
                Verdict::Doubtful
            };
        }
        self.doubtful = 0;
        self.levels[step] = Some(own + LEARNING * (stops - own));
        Verdict::Fits
    }
}
