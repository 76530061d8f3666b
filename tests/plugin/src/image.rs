//! Images, by hand: `swm-render` draws better ones, but this crate needs discs only.

/// Fills a disc. `pixels` is `[H, W, 3]`; center and radius are in rinks, 0 to 1 over the image.
pub(crate) fn disc(pixels: &mut [u8], width: usize, center: [f64; 2], radius: f64, color: [u8; 3]) {
    let height = pixels.len() / 3 / width;
    for (row, line) in pixels.chunks_exact_mut(3 * width).enumerate() {
        for (column, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let x = (column as f64 + 0.5) / width as f64 - center[0];
            let y = (row as f64 + 0.5) / height as f64 - center[1];
            if x.hypot(y) <= radius {
                *pixel = color;
            }
        }
    }
}
