//! Assigns layers of the shadow maps to lamps. A static lamp keeps its layers and their contents,
//! whichever other lamps are added or removed.

use glam::Mat4;

/// The maps of one lamp.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LampViews {
    /// Projections of the views, layer by layer; the same number in each.
    pub clips: Vec<Mat4>,
    /// Number of layers, which are consecutive.
    pub layers: usize,
}

/// The layers of a lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Assigned {
    /// The first layer.
    pub first: usize,
    /// Whether the layers hold other contents and must be drawn.
    pub stale: bool,
}

#[derive(Debug)]
struct Block {
    first: usize,
    views: LampViews,
}

/// The layers in use.
#[derive(Debug, Default)]
pub struct LampLayers {
    blocks: Vec<Block>,
}

impl LampLayers {
    /// Forgets the contents of all layers.
    pub fn forget(&mut self) {
        self.blocks.clear();
    }

    /// Assigns layers to each lamp out of `layers`, which are enough for all.
    pub fn assign(&mut self, lamps: Vec<LampViews>, layers: usize) -> Vec<Assigned> {
        let mut old = std::mem::take(&mut self.blocks);
        let kept: Vec<Option<Block>> = lamps
            .iter()
            .map(|lamp| {
                let same = old.iter().position(|b| b.views == *lamp);
                same.map(|i| old.swap_remove(i))
            })
            .collect();
        let mut free = vec![true; layers];
        for block in kept.iter().flatten() {
            free[block.first..block.first + block.views.layers].fill(false);
        }
        let mut assigned = Vec::with_capacity(lamps.len());
        for (views, kept) in lamps.iter().zip(&kept) {
            let place = match kept {
                Some(block) => Some((block.first, false)),
                None => take(&mut free, views.layers).map(|first| (first, true)),
            };
            let Some((first, stale)) = place else {
                return self.packed(lamps);
            };
            assigned.push(Assigned { first, stale });
        }
        let blocks = lamps.into_iter().zip(&assigned);
        self.blocks = blocks
            .map(|(views, a)| Block {
                first: a.first,
                views,
            })
            .collect();
        assigned
    }

    /// Assigns all layers again without gaps, where the gaps have become too small.
    fn packed(&mut self, lamps: Vec<LampViews>) -> Vec<Assigned> {
        let mut next = 0;
        self.blocks = lamps
            .into_iter()
            .map(|views| {
                let first = next;
                next += views.layers;
                Block { first, views }
            })
            .collect();
        let first = |block: &Block| Assigned {
            first: block.first,
            stale: true,
        };
        self.blocks.iter().map(first).collect()
    }
}

/// Takes the first run of `layers` free layers.
fn take(free: &mut [bool], layers: usize) -> Option<usize> {
    let fits = |first: &usize| free[*first..*first + layers].iter().all(|f| *f);
    let first = (0..=free.len().checked_sub(layers)?).find(fits)?;
    free[first..first + layers].fill(false);
    Some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views(at: f32, layers: usize) -> LampViews {
        LampViews {
            clips: vec![Mat4::from_scale(glam::Vec3::splat(at)); layers],
            layers,
        }
    }

    fn firsts(assigned: &[Assigned]) -> Vec<(usize, bool)> {
        assigned.iter().map(|a| (a.first, a.stale)).collect()
    }

    #[test]
    fn lamp_keeps_its_layers_when_others_are_removed_or_added() {
        let mut layers = LampLayers::default();
        let [a, b, c] = [views(1.0, 1), views(2.0, 6), views(3.0, 1)];
        let all = layers.assign(vec![a.clone(), b.clone(), c.clone()], 8);
        assert_eq!(firsts(&all), [(0, true), (1, true), (7, true)]);
        let without = layers.assign(vec![b.clone(), c.clone()], 8);
        assert_eq!(firsts(&without), [(1, false), (7, false)]);
        let again = layers.assign(vec![c, a, b], 8);
        assert_eq!(firsts(&again), [(7, false), (0, true), (1, false)]);
    }

    #[test]
    fn moved_lamp_is_drawn_again_and_equal_lamps_have_separate_layers() {
        let mut layers = LampLayers::default();
        let same = layers.assign(vec![views(1.0, 1), views(1.0, 1)], 2);
        assert_eq!(firsts(&same), [(0, true), (1, true)]);
        let moved = layers.assign(vec![views(1.0, 1), views(5.0, 1)], 2);
        assert_eq!(firsts(&moved), [(0, false), (1, true)]);
    }

    #[test]
    fn small_gaps_are_closed() {
        let mut layers = LampLayers::default();
        layers.assign(vec![views(1.0, 3), views(2.0, 1), views(3.0, 3)], 7);
        let packed = layers.assign(vec![views(2.0, 1), views(9.0, 6)], 7);
        assert_eq!(firsts(&packed), [(0, true), (1, true)]);
    }

    #[test]
    fn lamps_without_casters_need_no_layers() {
        let mut layers = LampLayers::default();
        assert_eq!(layers.assign(vec![views(1.0, 0)], 0).len(), 1);
        layers.assign(vec![views(1.0, 1)], 1);
        layers.forget();
        assert!(layers.assign(vec![views(1.0, 1)], 1)[0].stale);
    }
}
