//! The outcome of asking a source for its next item with a timeout.

/// The next item of a live source, or why there is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Next<T> {
    /// An item.
    Item(T),
    /// Nothing arrived within the timeout.
    Idle,
    /// The source has ended; no item will follow.
    Ended,
}
