use super::*;
use crate::Detector;
use penumbra_camera::Response;
use std::fmt::Write;

/// Five markers of 5×5 bits that are not in a built-in dictionary, row by row.
const BITS: [&str; 5] = [
    "1010111000101101001001110",
    "0111001011100010110101001",
    "1100010110011101010001011",
    "0001101110110001011010010",
    "1111000001010111000110100",
];

fn opencv_yaml() -> String {
    let mut text =
        String::from("%YAML:1.0\n---\nnmarkers: 5\nmarkersize: 5\nmaxCorrectionBits: 1\n");
    for (i, bits) in BITS.iter().enumerate() {
        let _ = writeln!(text, "marker_{i}: \"{bits}\"");
    }
    text
}

fn opencv_xml() -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n<nmarkers>5</nmarkers>\n<markersize>5</markersize>\n\
         <maxCorrectionBits>1</maxCorrectionBits>\n",
    );
    for (i, bits) in BITS.iter().enumerate() {
        let _ = writeln!(text, "<marker_{i}>\n  \"{bits}\"</marker_{i}>");
    }
    text + "</opencv_storage>\n"
}

fn list() -> String {
    let spaced = |bits: &str| {
        let rows: Vec<_> = bits
            .as_bytes()
            .chunks(5)
            .map(|r| str::from_utf8(r).unwrap())
            .collect();
        rows.join(" ")
    };
    let lines: Vec<_> = BITS
        .iter()
        .map(|bits| spaced(bits) + " # a marker")
        .collect();
    format!("# my markers\n\n{}\n", lines.join("\n"))
}

#[test]
fn the_three_formats_are_the_same_dictionary() {
    let all =
        [opencv_yaml(), opencv_xml(), list()].map(|text| definition("x".into(), &text).unwrap());
    assert_eq!(all[0], all[1]);
    assert_eq!(all[0].words, all[2].words);
    assert_eq!(
        (all[0].side, all[0].words[0]),
        (5, 0b1_0101_1100_0101_1010_0100_1110)
    );
    assert!(all[0].max_wrong_bits <= 1);
}

/// The marker of `id`, ten pixels a module, within two white modules.
fn picture(family: Family, id: u32) -> (Vec<u8>, usize) {
    let (n, pixels) = (family.modules() as usize + 4, 10);
    let side = n * pixels;
    let mut grey = vec![255; side * side];
    for (i, value) in grey.iter_mut().enumerate() {
        let (x, y) = (i % side / pixels, i / side / pixels);
        let inside = (2..n - 2).contains(&x) && (2..n - 2).contains(&y);
        if inside && !family.is_white(id, x as u32 - 2, y as u32 - 2) {
            *value = 0;
        }
    }
    (grey, side)
}

#[test]
fn markers_are_detected_and_read() {
    let family = Dictionary::register("Detected-5x5", &opencv_yaml()).unwrap();
    assert_eq!(family.to_string(), "detected-5x5");
    assert_eq!("detected-5x5".parse(), Ok(family));
    assert_eq!((family.count(), family.modules()), (5, 7));
    let mut detector = Detector::new(&[family], &Response::srgb());
    for id in 0..5 {
        let (grey, side) = picture(family, id);
        let tags = detector.detect_grey(&grey, side, side, None);
        let found: Vec<_> = tags
            .iter()
            .map(|t| (t.family, t.id, t.wrong_bits))
            .collect();
        assert_eq!(found, [(family, id, 0)]);
        // Clockwise as the marker is read, from the top left.
        assert!(tags[0].corners[0].length() < 40.0, "{:?}", tags[0].corners);
    }
}

#[test]
fn a_name_stands_for_one_dictionary() {
    let family = Dictionary::register("once", &list()).unwrap();
    assert_eq!(Dictionary::register("ONCE", &list()), Ok(family));
    let other = list().replacen('1', "0", 1);
    assert!(matches!(
        Dictionary::register("once", &other),
        Err(DictionaryError::Taken { .. })
    ));
    for name in ["", "tag36h11", "4x4_50", "DICT_4X4_50", "a b", "a/b"] {
        let refused = Dictionary::register(name, &list());
        assert!(
            matches!(refused, Err(DictionaryError::Name { .. })),
            "{name}"
        );
    }
}

#[test]
fn mistakes_are_named() {
    let message = |text: &str| definition("x".into(), text).unwrap_err().to_string();
    assert!(message("").contains("marker_0"));
    assert!(message("01012\n").contains("line 1"));
    assert!(message("0101\n").contains("3 to 8 bits a side, found 2"));
    let yaml = opencv_yaml();
    assert!(message(&yaml.replace("nmarkers: 5", "nmarkers: 6")).contains("there are 5"));
    assert!(message(&yaml.replace("marker_3", "marker_7")).contains("marker_3: is missing"));
    assert!(message(&yaml.replace("marker_3", "marker_2")).contains("stands twice"));
    assert!(message(&yaml.replace("marker_3", "marker_9999999")).contains("marker_4095"));
    assert!(message(&yaml.replace("markersize: 5", "markersize: five")).contains("whole number"));
    assert!(message(&yaml.replace("markersize: 5", "markersize: 4")).contains("16 digits"));
    assert!(message(&yaml.replace(BITS[1], "2")).contains("marker_1: expected 25 digits"));
    // The second marker is the first one, turned.
    let turned = rotated(u64::from_str_radix(BITS[0], 2).unwrap(), 5);
    let same = yaml.replace(BITS[1], &format!("{turned:025b}"));
    assert!(message(&same).contains("marker 0 and marker 1"));
    let even = yaml.replace(BITS[1], &"0".repeat(25));
    assert!(message(&even).contains("marker 1 and marker 1"));
}

proptest::proptest! {
    #[test]
    fn no_text_panics(text in "[a-z_0-9:<>/\\n\" #]{0,200}") {
        let _ = definition("x".into(), &format!("marker_0{text}"));
        let _ = definition("x".into(), &format!("<opencv_storage>{text}"));
        let _ = definition("x".into(), &text);
    }
}
