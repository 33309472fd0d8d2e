"""Facts of a sampled signal, each defined once: swing, noise, resolution, correlation."""
