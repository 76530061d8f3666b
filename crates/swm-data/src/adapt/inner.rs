//! Methods of datasets that a dataset of a dataset passes on.

/// Passes methods of [`Dataset`](crate::Dataset) on to the dataset `inner`: `info` where it has no other, `rows` and the looks of
/// their images, their `origin`, `checks` of an episode and of the whole, `encodings` of rows as they are stored.
macro_rules! of_inner {
    ($($part:ident),+) => {
        $(crate::adapt::inner::of_inner!(@$part);)+
    };
    (@info) => {
        fn info(&self) -> &crate::dataset::DatasetInfo {
            self.inner.info()
        }
    };
    (@rows) => {
        fn rows(
            &mut self,
            column: usize,
            episode: usize,
            steps: crate::dataset::Steps,
            out: swm_core::SliceMut<'_>,
        ) -> Result<(), crate::error::DataError> {
            self.inner.rows(column, episode, steps, out)
        }

        crate::adapt::inner::of_inner!(@looks);
    };
    (@looks) => {
        fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), crate::error::DataError> {
            self.inner.dress(key)
        }
    };
    (@origin) => {
        fn origin(&self) -> Option<crate::dataset::Origin> {
            self.inner.origin()
        }
    };
    (@checks) => {
        fn check_whole(&mut self) -> Result<(), crate::error::DataError> {
            self.inner.check_whole()
        }

        fn check_episode(&mut self, episode: usize) -> Result<(), crate::error::DataError> {
            self.inner.check_episode(episode)
        }
    };
    (@encodings) => {
        fn encoding(&self, column: usize) -> Option<&str> {
            self.inner.encoding(column)
        }

        fn encoded_rows(
            &mut self,
            column: usize,
            episode: usize,
            rows: std::ops::Range<usize>,
            out: &mut crate::dataset::EncodedRows,
        ) -> Result<(), crate::error::DataError> {
            self.inner.encoded_rows(column, episode, rows, out)
        }
    };
}

pub(crate) use of_inner;
