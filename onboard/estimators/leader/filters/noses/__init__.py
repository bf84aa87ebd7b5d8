"""The cloud of noses: where the leader may be when its nose may point anywhere. Start reading at `particles`."""
