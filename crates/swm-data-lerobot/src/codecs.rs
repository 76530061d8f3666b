//! Codecs of the column chunks of Parquet: which are read, and what to do about the others.

use parquet::basic::Compression;
use parquet::file::metadata::{ParquetMetaData, RowGroupMetaData};
use swm_data::error::{Result, unsupported};

/// Whether all columns of a file are in codecs that are read.
///
/// # Errors
///
/// The first column that is not, with its codec and the fix: without it, a dataset would have a column less.
pub(super) fn check(file: &ParquetMetaData) -> Result<()> {
    for chunk in file.row_groups().iter().flat_map(RowGroupMetaData::columns) {
        let codec = match chunk.compression() {
            Compression::BROTLI(_) => "Brotli",
            Compression::LZO => "LZO",
            Compression::UNCOMPRESSED
            | Compression::SNAPPY
            | Compression::GZIP(_)
            | Compression::ZSTD(_)
            | Compression::LZ4
            | Compression::LZ4_RAW => continue,
        };
        let column = chunk.column_path().parts().first().map_or("", String::as_str);
        return Err(unsupported(format!(
            "column `{column}` is compressed by {codec}, which is not read; write the table by zstd, in Python with \
             `pq.write_table(pq.read_table(FILE), FILE, compression=\"zstd\")` of pyarrow.parquet"
        )));
    }
    Ok(())
}
