"""The embedded bank: a base network and 11 sources, really trained, and four benchmarks to merge for."""
