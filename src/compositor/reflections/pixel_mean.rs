//! The mean of what places within a pixel mirror.

use super::nearby::Nearby;

/// Share of the distance by which two places within a pixel may differ and show the same surface.
const SAME: f32 = 0.02;

/// What a surface mirrors on average at the places within a pixel that show it: the nearest one.
#[derive(Default)]
pub struct PixelMean {
    sum: Option<Nearby>,
    count: f32,
}

/// Whether two places within a pixel show the same surface.
pub fn is_same(a: &Nearby, b: &Nearby) -> bool {
    (a.z - b.z).abs() <= SAME * b.z.abs()
}

impl PixelMean {
    pub const fn of(first: Nearby) -> Self {
        Self {
            sum: Some(first),
            count: 1.0,
        }
    }

    pub fn add(&mut self, more: Nearby) {
        if more.z == 0.0 {
            return;
        }
        match &mut self.sum {
            Some(sum) if is_same(&more, sum) => {
                sum.light += more.light;
                sum.open += more.open;
                // The place is a mean over what is seen.
                let seen = sum.seen + more.seen;
                sum.place = (sum.place * sum.seen + more.place * more.seen) / seen.max(1e-6);
                sum.seen = seen;
                self.count += 1.0;
            }
            Some(sum) if sum.z.abs() <= more.z.abs() => (),
            _ => (self.sum, self.count) = (Some(more), 1.0),
        }
    }

    pub fn mean(self) -> Nearby {
        self.sum.map_or(Nearby::NOTHING, |sum| Nearby {
            light: sum.light / self.count,
            open: sum.open / self.count,
            seen: sum.seen / self.count,
            ..sum
        })
    }
}
