//! Buffers for pictures, used again once nobody holds them.

use bytes::Bytes;
use std::sync::{Arc, Mutex, PoisonError};

/// More free buffers than this are given back to the system: readers were slow once.
const KEPT: usize = 16;

/// A store of buffers. Cheap to clone: all clones share one store.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pool {
    free: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl Pool {
    /// Bytes that `fill` writes into a buffer that was used before, where there is one. The
    /// buffer comes back when the last clone of the bytes is dropped, on whatever thread.
    pub(crate) fn bytes(&self, fill: impl FnOnce(&mut Vec<u8>)) -> Bytes {
        let mut buffer = self.lock().pop().unwrap_or_default();
        buffer.clear();
        fill(&mut buffer);
        Bytes::from_owner(Lent {
            buffer,
            pool: self.clone(),
        })
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Vec<u8>>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A buffer out of the store.
struct Lent {
    buffer: Vec<u8>,
    pool: Pool,
}

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        &self.buffer
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        let mut free = self.pool.lock();
        if free.len() < KEPT {
            free.push(std::mem::take(&mut self.buffer));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_is_used_again_once_all_clones_are_gone() {
        let pool = Pool::default();
        let first = pool.bytes(|b| b.extend_from_slice(&[1; 1000]));
        let place = first.as_ptr();
        let clone = first.slice(10..);
        drop(first);
        let second = pool.bytes(|b| b.extend_from_slice(&[2; 1000]));
        assert_ne!(second.as_ptr(), place, "still held");
        drop(clone);
        let third = pool.bytes(|b| b.extend_from_slice(&[3; 500]));
        assert_eq!(third.as_ptr(), place);
        assert_eq!((third.len(), &second[..2]), (500, &[2, 2][..]));
    }

    #[test]
    fn the_store_does_not_grow_without_bound() {
        let pool = Pool::default();
        let many: Vec<Bytes> = (0..100).map(|_| pool.bytes(|b| b.push(0))).collect();
        drop(many);
        assert_eq!(pool.lock().len(), KEPT);
    }
}
