//! Families of tags and boards on the command line, where the file of a dictionary may stand in place of
//! a family's name.

use penumbra_calibration::intrinsics::Board;
use penumbra_config::register_dictionary;
use penumbra_fiducials::{DICTIONARY_ENDINGS, Family};
use std::path::Path;

/// Parses the name of a family, or reads the file of a dictionary.
///
/// # Errors
/// The message for the user.
pub fn family(text: &str) -> Result<Family, String> {
    let low = text.to_ascii_lowercase();
    if DICTIONARY_ENDINGS.iter().any(|end| low.ends_with(end)) {
        return register_dictionary(Path::new(text));
    }
    text.parse()
        .map_err(|error: penumbra_fiducials::UnknownFamily| error.to_string())
}

/// Parses a board; its last part may be the file of a dictionary.
///
/// # Errors
/// The message for the user.
pub fn board(text: &str) -> Result<Board, String> {
    let named = match text.rsplit_once(':') {
        Some((front, last)) if last.contains('.') && last.parse::<f64>().is_err() => {
            format!("{front}:{}", family(last)?)
        }
        _ => text.to_owned(),
    };
    Board::parse(&named).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_stands_for_a_family() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cli-test.txt");
        let bits = "1010111000101101001001110\n0111001011100010110101001\n\
                    1100010110011101010001011\n0001101110110001011010010\n";
        std::fs::write(&path, bits).unwrap();
        let path = path.to_str().unwrap();
        let custom = family(path).unwrap();
        assert_eq!(custom.to_string(), "cli-test");
        assert_eq!(family("4x4_50"), Ok(Family::Aruco4x4(50)));
        let found = board(&format!("charuco:3x3:0.03:0.022:{path}")).unwrap();
        assert_eq!(found.family(), Some(custom));
        assert!(board("chess:9x6:0.025").is_ok());
        assert!(board("aprilgrid:6x6:0.03:0.3").is_ok());
        let gone = family("gone.yml").unwrap_err();
        assert!(
            gone.starts_with("gone.yml: there is no such file"),
            "{gone}"
        );
        let large = board(&format!("charuco:9x9:0.03:0.022:{path}")).unwrap_err();
        assert!(large.contains("more tags than its dictionary"), "{large}");
    }
}
