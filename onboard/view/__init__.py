"""The live view: a client of the published records.

It draws records in Rerun and is independent of the filters. It runs in its own process, fed from Zenoh, or in a
replay: either way it cannot stall an estimator. Rerun is the extra `view`; this package
imports without it, `onboard.view.view` and its neighbours do not.

    Records -> drawing -> Columns -> (every 0.1 s of flight) -> one Rerun stream -> viewer and/or .rrd
"""
