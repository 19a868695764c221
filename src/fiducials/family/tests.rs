use super::*;
use std::collections::HashSet;

#[test]
fn each_bit_has_its_own_module() {
    for family in Family::ALL {
        let all: HashSet<_> = (0..family.bits()).map(|b| family.module(b)).collect();
        assert_eq!(all.len() as u32, family.bits());
        let side = family.border()..family.modules() - family.border();
        assert!(
            all.iter()
                .all(|(x, y)| side.contains(x) && side.contains(y))
        );
    }
    // From AprilTag's tables.
    assert_eq!(Family::Tag36h11.module(8), (3, 3));
    assert_eq!(Family::Tag36h11.module(9), (6, 1));
    assert_eq!(Family::Tag36h11.module(35), (3, 4));
    assert_eq!(Family::Kalibr36h11.module(8), (4, 4));
    assert_eq!(Family::Tag25h9.module(24), (3, 3));
    assert_eq!(Family::Tag16h5.module(15), (2, 3));
}

/// Minimum Hamming distances from the families' names or OpenCV's documentation.
#[test]
fn words_keep_their_hamming_distance_in_all_rotations() {
    for (family, apart) in [
        (Family::Tag36h11, 11),
        (Family::Tag25h9, 9),
        (Family::Tag16h5, 5),
        (Family::Aruco4x4(50), 4),
        (Family::Aruco5x5(250), 6),
        (Family::Aruco6x6(250), 11),
        (Family::Aruco7x7(100), 18),
        (Family::ArucoMip36h12, 12),
    ] {
        let words = family.words();
        for (i, word) in words.iter().enumerate() {
            let mut rotated = *word;
            for turn in 0..4 {
                let others = words
                    .iter()
                    .enumerate()
                    .filter(|(k, _)| turn > 0 || *k != i);
                let nearest = others.map(|(_, w)| (w ^ rotated).count_ones()).min();
                assert!(nearest.unwrap() >= apart, "{family} {i} {turn}");
                rotated = family.rotated(rotated);
            }
            assert_eq!(rotated, *word);
        }
    }
}

#[test]
fn rotated_word_is_the_word_of_the_rotated_tag() {
    for family in Family::ALL {
        let word = family.words()[7];
        let white = |word: u64, at: (u32, u32)| {
            (0..family.bits())
                .any(|b| family.module(b) == at && (word >> (family.bits() - 1 - b)) & 1 == 1)
        };
        let last = family.modules() - 1;
        for bit in 0..family.bits() {
            let (x, y) = family.module(bit);
            assert_eq!(
                white(family.rotated(word), (x, y)),
                white(word, (last - y, x)),
                "{family} {x} {y}"
            );
        }
    }
}

#[test]
fn corrects_wrong_bits_and_rejects_noise() {
    let family = Family::Tag36h11;
    let word = family.words()[341] ^ 0b10_0000_0001;
    let found = family.look_up(word).unwrap();
    assert_eq!((found.id, found.wrong, found.turns), (341, 2, 0));
    assert_eq!(family.look_up(family.words()[341] ^ 0b111), None);
    assert_eq!(family.look_up(0), None);
}

#[test]
fn parses_own_and_opencv_family_names() {
    for family in Family::ALL {
        assert_eq!(family.to_string().parse::<Family>().unwrap(), family);
    }
    for (text, family) in [
        ("DICT_4X4_50", Family::Aruco4x4(50)),
        ("7x7_250", Family::Aruco7x7(250)),
        ("DICT_APRILTAG_36h11", Family::Tag36h11),
        ("DICT_ARUCO_ORIGINAL", Family::ArucoOriginal),
    ] {
        assert_eq!(text.parse::<Family>().unwrap(), family);
    }
    for text in ["tag36h10", "4x4_51", "", "8x8_50"] {
        assert!(text.parse::<Family>().is_err(), "{text}");
    }
    assert_eq!(Family::Aruco4x4(60_000).count(), 1000);
}

/// Compares with OpenCV's `generateImageMarker`.
#[test]
fn markers_match_opencv() {
    let rows = |family: Family, id: u32| -> Vec<String> {
        let inner = family.border()..family.modules() - family.border();
        let cell = |x, y| if family.is_white(id, x, y) { '1' } else { '0' };
        inner
            .clone()
            .map(|y| inner.clone().map(|x| cell(x, y)).collect())
            .collect()
    };
    assert_eq!(
        rows(Family::Aruco4x4(50), 0),
        ["1011", "0101", "0011", "0010"]
    );
    assert_eq!(
        rows(Family::ArucoOriginal, 5),
        ["10000", "10000", "10000", "10111", "10111"]
    );
}
