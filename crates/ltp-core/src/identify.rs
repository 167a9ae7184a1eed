//! Level 3: harmonic transfer functions from recordings, without any model.
