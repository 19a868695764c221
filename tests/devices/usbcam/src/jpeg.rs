//! A JPEG encoder for pictures of flat blocks.
//!
//! Each 16×16 block has one colour, so that all coefficients but the first are zero and a frame
//! takes microseconds, which matters because the processor is emulated too. The file is a
//! baseline JPEG, 4:2:0, full-range BT.601, as cameras send it. Source: ITU-T T.81, Annex B
//! (markers), F (coding) and K.3 (typical Huffman tables).

/// Width and height of a block of one colour, pixels.
pub const BLOCK: usize = 16;

/// Full-range luma, blue difference, red difference.
pub type YCbCr = [u8; 3];

/// First entries of the typical tables: code lengths, then values. Codes are canonical, so
/// omitting the later entries, which flat blocks do not need, does not change these.
struct HuffmanTable {
    class_and_id: u8,
    lengths: [u8; 16],
    values: &'static [u8],
}

const CATEGORIES: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
const TABLES: [HuffmanTable; 4] = [
    HuffmanTable {
        class_and_id: 0x00,
        lengths: [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0],
        values: CATEGORIES,
    },
    HuffmanTable {
        class_and_id: 0x01,
        lengths: [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0],
        values: CATEGORIES,
    },
    HuffmanTable {
        class_and_id: 0x10,
        lengths: [0, 2, 1, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        values: &[0x01, 0x02, 0x03, 0x00, 0x04, 0x11],
    },
    HuffmanTable {
        class_and_id: 0x11,
        lengths: [0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        values: &[0x00, 0x01],
    },
];

/// Code and its length in bits, by category of difference.
const LUMA: [(u32, u32); 9] = [
    (0b00, 2),
    (0b010, 3),
    (0b011, 3),
    (0b100, 3),
    (0b101, 3),
    (0b110, 3),
    (0b1110, 4),
    (0b1_1110, 5),
    (0b11_1110, 6),
];
const CHROMA: [(u32, u32); 9] = [
    (0b00, 2),
    (0b01, 2),
    (0b10, 2),
    (0b110, 3),
    (0b1110, 4),
    (0b1_1110, 5),
    (0b11_1110, 6),
    (0b111_1110, 7),
    (0b1111_1110, 8),
];
const LUMA_END: (u32, u32) = (0b1010, 4);
const CHROMA_END: (u32, u32) = (0b00, 2);

/// A picture of blocks, row after row.
pub struct Blocks<'a> {
    /// Pixels in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// One colour per block; blocks at the right and lower edge may extend beyond the picture.
    pub colours: &'a [YCbCr],
}

/// Encodes the picture. Many cameras omit the Huffman tables; a decoder must then use the typical
/// ones.
#[must_use]
pub fn encode(picture: &Blocks, with_tables: bool) -> Vec<u8> {
    let mut file = headers(picture.width, picture.height, with_tables);
    let mut bits = Bits::onto(&mut file);
    let mut previous = [128_u8; 3];
    for colour in picture.colours {
        bits.block(&LUMA, LUMA_END, difference(colour[0], previous[0]));
        for _ in 1..4 {
            bits.block(&LUMA, LUMA_END, 0);
        }
        for channel in [1, 2] {
            let change = difference(colour[channel], previous[channel]);
            bits.block(&CHROMA, CHROMA_END, change);
        }
        previous = *colour;
    }
    bits.finish();
    file.extend([0xff, 0xd9]);
    file
}

fn headers(width: u16, height: u16, with_tables: bool) -> Vec<u8> {
    let mut file = vec![0xff, 0xd8];
    segment(&mut file, 0xe0, b"JFIF\0\x01\x01\0\0\x01\0\x01\0\0");
    // The DC coefficient is 8 times the mean of 8x8 values: with a quantum of 8, one code value is
    // one step.
    let mut quanta = vec![0];
    quanta.extend([8; 64]);
    segment(&mut file, 0xdb, &quanta);
    let [h1, h0] = height.to_be_bytes();
    let [w1, w0] = width.to_be_bytes();
    let frame = [8, h1, h0, w1, w0, 3, 1, 0x22, 0, 2, 0x11, 0, 3, 0x11, 0];
    segment(&mut file, 0xc0, &frame);
    if with_tables {
        for table in &TABLES {
            let mut body = vec![table.class_and_id];
            body.extend(table.lengths);
            body.extend(table.values);
            segment(&mut file, 0xc4, &body);
        }
    }
    segment(&mut file, 0xda, &[3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0]);
    file
}

fn segment(file: &mut Vec<u8>, marker: u8, body: &[u8]) {
    file.extend([0xff, marker]);
    file.extend((body.len() as u16 + 2).to_be_bytes());
    file.extend(body);
}

fn difference(value: u8, previous: u8) -> i32 {
    i32::from(value) - i32::from(previous)
}

/// Writes bits, highest first. A byte FF is followed by a zero byte, so that it is no marker.
struct Bits<'a> {
    file: &'a mut Vec<u8>,
    pending: u32,
    count: u32,
}

impl<'a> Bits<'a> {
    fn onto(file: &'a mut Vec<u8>) -> Self {
        Self {
            file,
            pending: 0,
            count: 0,
        }
    }

    fn block(&mut self, codes: &[(u32, u32); 9], end: (u32, u32), difference: i32) {
        let category = 32 - difference.unsigned_abs().leading_zeros();
        let (code, length) = codes[category as usize];
        self.put(code, length);
        // Negative values as ones' complement (T.81, F.1.2.1).
        let value = if difference < 0 {
            difference - 1
        } else {
            difference
        };
        self.put(value as u32 & ((1 << category) - 1), category);
        self.put(end.0, end.1);
    }

    fn put(&mut self, bits: u32, length: u32) {
        self.pending = self.pending << length | bits;
        self.count += length;
        while self.count >= 8 {
            self.count -= 8;
            let byte = (self.pending >> self.count) as u8;
            self.file.push(byte);
            if byte == 0xff {
                self.file.push(0);
            }
        }
        self.pending &= (1 << self.count) - 1;
    }

    fn finish(mut self) {
        let padding = (8 - self.count) % 8;
        self.put((1 << padding) - 1, padding);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Vec<YCbCr> {
        (0..40 * 30_u32)
            .map(|i| [(i * 7) as u8, (i * 31 / 3) as u8, 255 - (i * 13) as u8])
            .collect()
    }

    #[test]
    fn blocks_decode_to_their_colours() {
        let colours = picture();
        let blocks = Blocks {
            width: 640,
            height: 480,
            colours: &colours,
        };
        for with_tables in [true, false] {
            let file = encode(&blocks, with_tables);
            let yuv = turbojpeg::decompress_to_yuv(&file).unwrap();
            assert_eq!((yuv.width, yuv.height), (640, 480));
            for (i, colour) in colours.iter().enumerate() {
                let (x, y) = (i % 40 * 16 + 5, i / 40 * 16 + 11);
                let chroma = (y / 2) * 320 + x / 2;
                let planes = 640 * 480;
                let got = [
                    yuv.pixels[y * 640 + x],
                    yuv.pixels[planes + chroma],
                    yuv.pixels[planes + 320 * 240 + chroma],
                ];
                assert_eq!(got, *colour, "block {i}");
            }
        }
    }

    #[test]
    fn tables_are_omitted_on_request() {
        let colours = picture();
        let blocks = Blocks {
            width: 640,
            height: 480,
            colours: &colours,
        };
        let has_tables = |file: &[u8]| file.windows(2).any(|pair| pair == [0xff, 0xc4]);
        assert!(has_tables(&encode(&blocks, true)));
        assert!(!has_tables(&encode(&blocks, false)));
    }
}
