//! The token that protects a status server which other machines can reach.

/// Characters of a token beside letters and digits; none needs quoting in an address or a cookie.
const TOKEN_EXTRA: &str = "-._~";
/// Minimum length; shorter tokens can be guessed.
const MIN_TOKEN: usize = 12;
const MAX_TOKEN: usize = 256;

/// Whether `text` is a valid token: long enough, and without characters that need quoting.
#[must_use]
pub fn is_token(text: &str) -> bool {
    let fit = |c: char| c.is_ascii_alphanumeric() || TOKEN_EXTRA.contains(c);
    (MIN_TOKEN..=MAX_TOKEN).contains(&text.len()) && text.chars().all(fit)
}
