"""Many runs of a station: what they vary, what they measure, where they are computed."""
