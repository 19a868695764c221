//! The token that protects a status server which other machines can reach.

/// What a token may be: nothing that would need quoting in an address or a cookie.
const TOKEN_EXTRA: &str = "-._~";
/// Shorter ones can be guessed.
const MIN_TOKEN: usize = 12;
const MAX_TOKEN: usize = 256;

/// Whether a text cannot be guessed and needs no quoting, as a token must be.
#[must_use]
pub fn is_token(text: &str) -> bool {
    let fit = |c: char| c.is_ascii_alphanumeric() || TOKEN_EXTRA.contains(c);
    (MIN_TOKEN..=MAX_TOKEN).contains(&text.len()) && text.chars().all(fit)
}
