"""The filter of one target: `belief`, made of a configuration by `make`. Images come by `features` and
`measurement`, reports and ranges by `auxiliary`; the hypotheses are in `noses`."""
