//! Colors of pixels that stand side by side, put into planes of their own: what encoders of videos and loaders of images want.

use wide::u8x16;

/// `[N, 3]` → three times `[N]`, which have this length.
// 32 pixels at a time, in one function and without arrays that are mapped: it has to be inlined to be fast.
pub fn split_colors(pixels: &[u8], [red, green, blue]: [&mut [u8]; 3]) {
    const PIXELS: usize = 32;
    let (blocks, rest) = pixels.as_chunks::<{ 3 * PIXELS }>();
    let (reds, red) = red.as_chunks_mut::<PIXELS>();
    let (greens, green) = green.as_chunks_mut::<PIXELS>();
    let (blues, blue) = blue.as_chunks_mut::<PIXELS>();
    for (((block, red), green), blue) in blocks.iter().zip(reds).zip(greens).zip(blues) {
        let lanes = |at: usize| {
            let mut lanes = [0; 16];
            lanes.copy_from_slice(&block[16 * at..16 * at + 16]);
            u8x16::new(lanes)
        };
        // Of 96 values, deals those of the first half and those of the second in turns, so that values `i` and `i + 48`
        // become neighbors. After five times, value `3 i + channel` stands at `32 channel + i`.
        let deal = |[a, b, c, d, e, f]: [u8x16; 6]| {
            let (low, high) = (u8x16::unpack_low, u8x16::unpack_high);
            [low(a, d), high(a, d), low(b, e), high(b, e), low(c, f), high(c, f)]
        };
        let values = [lanes(0), lanes(1), lanes(2), lanes(3), lanes(4), lanes(5)];
        let [a, b, c, d, e, f] = deal(deal(deal(deal(deal(values)))));
        for (plane, [first, second]) in [(red, [a, b]), (green, [c, d]), (blue, [e, f])] {
            plane[..16].copy_from_slice(first.as_array());
            plane[16..].copy_from_slice(second.as_array());
        }
    }
    for (((pixel, red), green), blue) in rest.as_chunks::<3>().0.iter().zip(red).zip(green).zip(blue) {
        [*red, *green, *blue] = *pixel;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_color_finds_its_plane_whatever_the_number_of_pixels() {
        for pixels in [0, 1, 31, 32, 33, 400] {
            let stored: Vec<u8> = (0..pixels * 3).map(|i| (i * 7 + i / 11) as u8).collect();
            let mut planes = [(); 3].map(|()| vec![0; pixels]);
            split_colors(&stored, planes.each_mut().map(Vec::as_mut_slice));
            for (at, value) in stored.iter().enumerate() {
                assert_eq!(planes[at % 3][at / 3], *value, "{pixels}");
            }
        }
    }
}
