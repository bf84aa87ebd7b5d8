"""The filter of one leader.

`belief` is the filter: at its own time an image is compared with what all hypotheses expect, and corrects each of
them.

    start        the particles of hypotheses (`particles`) after a first image
    prediction   a step: each leader flies on (`motion`), and chance changes it (`draws`, `tilt`)
    update       an image (`view`, `gaussian`), a pose, and what is measured beside the images (`auxiliary`)
    summary      mean and covariance of the whole, and what is published; `places`, where the range is open

A new sensor's measurements of the leader come in as rows: `auxiliary`. What is assumed is in `assumptions`."""
