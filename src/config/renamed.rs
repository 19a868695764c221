//! Settings and values that had another name in earlier versions. A file that uses an old name is
//! refused with the new one.

use penumbra_strict_toml::{Fault, TomlText};

/// Old keys, section and name, and what to write instead.
const KEYS: [(&str, &str, &str); 9] = [
    ("environment", "lights", "is now called `light_placement`"),
    ("recording", "longest_s", "is now called `max_duration_s`"),
    (
        "sync",
        "longest_prediction_ms",
        "is now called `max_prediction_ms`",
    ),
    ("sync", "longest_wait_ms", "is now called `max_wait_ms`"),
    ("exposure", "darkest_ev", "is now called `min_ev`"),
    ("exposure", "brightest_ev", "is now called `max_ev`"),
    ("shading", "bounced_light", "is now called `indirect_light`"),
    (
        "shadows",
        "enabled",
        "is gone; `technique = \"image-based-lighting\"` casts no shadows",
    ),
    (
        "shadows",
        "resolution",
        "is gone; `[picture] quality` is \"live\" or \"best\"",
    ),
];

/// Old values of a setting: section, key, old value, new value.
const VALUES: [(&str, &str, &str, &str); 4] = [
    ("shadows", "technique", "dome", "image-based-shadowing"),
    ("shadows", "technique", "planes", "shadowing-planes"),
    ("sync", "follow_latency", "tell", "report"),
    ("replay", "pairing", "whole", "complete"),
];

/// Options, values and subcommands of the command line: option (empty for a subcommand), old value
/// (empty where the option itself was renamed), new word.
const WORDS: [(&str, &str, &str); 5] = [
    ("--lights", "", "--light-placement"),
    ("--technique", "dome", "image-based-shadowing"),
    ("--technique", "planes", "shadowing-planes"),
    ("--pairing", "whole", "complete"),
    ("", "photometric", "radiometric"),
];

/// Returns the message about a former word of the command line: the subcommand `value` if `option`
/// is empty, the option if `value` is empty, else `value` of `option`. `None` if it never was a
/// word.
#[must_use]
pub fn renamed_word(option: &str, value: &str) -> Option<String> {
    let (option_name, old, new) = WORDS
        .iter()
        .find(|(option_name, old, _)| *option_name == option && *old == value)?;
    Some(match (*option_name, *old) {
        ("", old) => format!("`{old}` is now called `{new}`"),
        (option_name, "") => format!("`{option_name}` is now called `{new}`"),
        (option_name, old) => format!("{option_name}: `{old}` is now called `{new}`"),
    })
}

/// The first old key or value in `text`; `None` if there is none or `text` is not TOML.
pub(super) fn renamed(text: &TomlText) -> Option<Fault> {
    let table: toml::Table = text.parse().ok()?;
    let value = |section: &str, key: &str| table.get(section)?.get(key);
    let key = KEYS
        .iter()
        .find(|(section, key, _)| value(section, key).is_some())
        .map(|(section, key, advice)| Fault::new(format!("{section}.{key}"), *advice));
    key.or_else(|| {
        VALUES
            .iter()
            .find(|(section, key, old, _)| {
                value(section, key).and_then(toml::Value::as_str) == Some(*old)
            })
            .map(|(section, key, old, new)| {
                Fault::new(
                    format!("{section}.{key}"),
                    format!("\"{old}\" is now called \"{new}\""),
                )
            })
    })
}
