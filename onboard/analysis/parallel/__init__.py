"""Work in parts, over all cores of this computer or a cluster's; the results in the order of the parts."""
