"""Registration kernels: arrays in, arrays out; numpy, scipy and numba only."""
