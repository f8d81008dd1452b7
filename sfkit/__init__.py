"""sfkit: merge stereo-matching networks, after the paper StereoFactory."""
