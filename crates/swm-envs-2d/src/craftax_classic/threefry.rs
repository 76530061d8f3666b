//! JAX's random stream: Threefry-2x32 with 20 rounds, and what `jax.random` makes of it.
//!
//! The cipher is that of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (SC 2011). How keys are split and bits
//! are counted is JAX's default since version 0.5 (`jax_threefry_partitionable`): the i-th key or word of a key comes from
//! the counter i alone.

/// A key of `jax.random`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Key([u32; 2]);

impl Key {
    /// `jax.random.PRNGKey(seed)` of a seed that is not negative, with 32-bit integers.
    pub(super) fn new(seed: u32) -> Self {
        Self([0, seed])
    }

    /// A key that [`Key::words`] gave.
    pub(super) fn from_words(words: [u32; 2]) -> Self {
        Self(words)
    }

    /// The words that it consists of.
    pub(super) fn words(self) -> [u32; 2] {
        self.0
    }

    /// The first key of `split(key)`: what the original goes on with.
    pub(super) fn next(self) -> Self {
        Self(self.block(0))
    }

    /// The second key of `split(key)`: what the original takes a value from.
    pub(super) fn side(self) -> Self {
        Self(self.block(1))
    }

    /// `uniform(key)`, in [0, 1).
    pub(super) fn uniform(self) -> f32 {
        self.uniform_at(0)
    }

    /// The value of index `index` of `uniform(key, shape)`.
    pub(super) fn uniform_at(self, index: u32) -> f32 {
        // 23 bits are the mantissa of a number in [1, 2).
        f32::from_bits((self.bits(index) >> 9) | 1.0_f32.to_bits()) - 1.0
    }

    /// `randint(key, (), 0, n)` for n a power of two up to 2^16. (Of others the high word counts, too.)
    pub(super) fn below_power_of_two(self, n: u32) -> u32 {
        debug_assert!(n.is_power_of_two() && n <= 1 << 16);
        self.side().bits(0) % n
    }

    /// The random word of index `index`.
    fn bits(self, index: u32) -> u32 {
        let [high, low] = self.block(index);
        high ^ low
    }

    /// The cipher of the counter (0, `count`).
    #[inline]
    fn block(self, count: u32) -> [u32; 2] {
        const ROTATIONS: [[u32; 4]; 2] = [[13, 15, 26, 6], [17, 29, 16, 24]];
        let [first, second] = self.0;
        let keys = [first, second, first ^ second ^ 0x1BD1_1BDA];
        let (mut x, mut y) = (first, count.wrapping_add(second));
        for group in 0..5 {
            for rotation in ROTATIONS[group % 2] {
                x = x.wrapping_add(y);
                y = y.rotate_left(rotation) ^ x;
            }
            x = x.wrapping_add(keys[(group + 1) % 3]);
            y = y.wrapping_add(keys[(group + 2) % 3]).wrapping_add(group as u32 + 1);
        }
        [x, y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cipher_gives_the_published_words() {
        // Known answers of the authors' library Random123.
        assert_eq!(Key([0, 0]).block(0), [0x6b20_0159, 0x99ba_4efe]);
    }

    #[test]
    fn keys_and_values_are_those_of_jax() {
        // jax.random.split, bits, uniform and randint of PRNGKey(7), JAX 0.10.2.
        let key = Key::new(7);
        assert_eq!((key.next().0, key.side().0), ([3625411723, 1954958720], [195045567, 4062205631]));
        assert_eq!([0, 1, 2].map(|i| key.bits(i)), [2895194379, 4185947648, 1300703658]);
        assert_eq!((key.uniform(), key.below_power_of_two(8)), (0.674_089_9, 7));
    }
}
