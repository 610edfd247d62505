"""Tables of predictions as large as one likes: a plan in, partitioned Parquet out."""
