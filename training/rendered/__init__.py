"""Images to train detectors on: a seed in, shards of labelled crops out; nothing but ``sim`` draws them."""
