//! What the fields of `/status` mean.

/// Path and meaning of every field, in the order of the JSON; `[]` stands for each element
/// of a list.
pub const STATUS_FIELDS: &[(&str, &str)] = &[];
