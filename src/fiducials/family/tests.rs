#![allow(clippy::unwrap_used)]
use super::*;
use std::collections::HashSet;

#[test]
fn every_bit_has_a_module_of_its_own() {
    for family in Family::ALL {
        let all: HashSet<_> = (0..family.bits()).map(|b| family.module(b)).collect();
        assert_eq!(all.len() as u32, family.bits());
        let side = family.border()..family.modules() - family.border();
        assert!(
            all.iter()
                .all(|(x, y)| side.contains(x) && side.contains(y))
        );
    }
    // As AprilTag's own tables have them.
    assert_eq!(Family::Tag36h11.module(8), (3, 3));
    assert_eq!(Family::Tag36h11.module(9), (6, 1));
    assert_eq!(Family::Tag36h11.module(35), (3, 4));
    assert_eq!(Family::Kalibr36h11.module(8), (4, 4));
    assert_eq!(Family::Tag25h9.module(24), (3, 3));
    assert_eq!(Family::Tag16h5.module(15), (2, 3));
}

/// Least distances as the families' names say, or as OpenCV states them.
#[test]
fn words_are_as_far_apart_as_their_family_says_however_they_are_turned() {
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
            let mut turned = *word;
            for turn in 0..4 {
                let others = words
                    .iter()
                    .enumerate()
                    .filter(|(k, _)| turn > 0 || *k != i);
                let nearest = others.map(|(_, w)| (w ^ turned).count_ones()).min();
                assert!(nearest.unwrap() >= apart, "{family} {i} {turn}");
                turned = family.turned(turned);
            }
            assert_eq!(turned, *word);
        }
    }
}

#[test]
fn a_turned_word_is_that_of_the_turned_square() {
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
                white(family.turned(word), (x, y)),
                white(word, (last - y, x)),
                "{family} {x} {y}"
            );
        }
    }
}

#[test]
fn a_word_with_wrong_bits_is_put_right_and_noise_is_no_tag() {
    let family = Family::Tag36h11;
    let word = family.words()[341] ^ 0b10_0000_0001;
    let found = family.look_up(word).unwrap();
    assert_eq!((found.id, found.wrong, found.turns), (341, 2, 0));
    assert_eq!(family.look_up(family.words()[341] ^ 0b111), None);
    assert_eq!(family.look_up(0), None);
}

#[test]
fn families_are_read_as_they_are_written_and_as_opencv_spells_them() {
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

/// The first markers of OpenCV's dictionaries as `generateImageMarker` draws them.
#[test]
fn markers_look_as_opencv_draws_them() {
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
