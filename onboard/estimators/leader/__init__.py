"""The motion of other aircraft relative to us, from images of them.

To be read from the top down:

estimator      which target an image is of, and who the leader is
tracks/        what is followed: starts, fuses, ends; `life_cycle` says what state it is in
reports/       what others say of the leader: its broadcast, ranges, an earlier run
hypotheses/    what is believed of it; a new sensor's rows come in at `auxiliary`
image/         what one image measures, and from where it was taken
config         what the user knows better than `assumptions`, which has the numbers that are believed"""
