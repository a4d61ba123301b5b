//! What the reference tells of another view.

/// What is known of a pixel of a view from the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Evidence {
    /// Nothing: it lies beyond the border of the reference, or beside a silhouette.
    None,
    /// The reference sees the same surface.
    Agrees,
    /// The reference sees something nearer, which does not hide it from this view.
    Hidden,
    /// The reference has seen through this place, or sees something there that this view has not seen.
    Contradicts,
}
