//! Memory for frames, reused when all clones of a frame are dropped.

use bytes::Bytes;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Free buffers beyond this number, which slow readers can cause, are deallocated.
const MAX_FREE: usize = 16;

/// A pool of buffers. All clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pool {
    free: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl Pool {
    /// Bytes that `fill` writes into an empty buffer. The buffer returns to the pool when the
    /// last clone of the bytes is dropped, on whichever thread.
    pub(crate) fn bytes(&self, fill: impl FnOnce(&mut Vec<u8>)) -> Bytes {
        let mut buffer = self.lock().pop().unwrap_or_default();
        buffer.clear();
        fill(&mut buffer);
        Bytes::from_owner(PooledBuffer {
            buffer,
            pool: self.clone(),
        })
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Vec<u8>>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A buffer that returns to its pool.
struct PooledBuffer {
    buffer: Vec<u8>,
    pool: Pool,
}

impl AsRef<[u8]> for PooledBuffer {
    fn as_ref(&self) -> &[u8] {
        &self.buffer
    }
}

impl Drop for PooledBuffer {
    fn drop(&mut self) {
        let mut free = self.pool.lock();
        if free.len() < MAX_FREE {
            free.push(std::mem::take(&mut self.buffer));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_is_reused_once_all_clones_are_dropped() {
        let pool = Pool::default();
        let first = pool.bytes(|b| b.extend_from_slice(&[1; 1000]));
        let address = first.as_ptr();
        let clone = first.slice(10..);
        drop(first);
        let second = pool.bytes(|b| b.extend_from_slice(&[2; 1000]));
        assert_ne!(second.as_ptr(), address, "still in use");
        drop(clone);
        let third = pool.bytes(|b| b.extend_from_slice(&[3; 500]));
        assert_eq!(third.as_ptr(), address);
        assert_eq!((third.len(), &second[..2]), (500, &[2, 2][..]));
    }

    #[test]
    fn the_number_of_free_buffers_is_limited() {
        let pool = Pool::default();
        let many: Vec<Bytes> = (0..100).map(|_| pool.bytes(|b| b.push(0))).collect();
        drop(many);
        assert_eq!(pool.lock().len(), MAX_FREE);
    }
}
