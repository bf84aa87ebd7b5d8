"""The `track` of one target, from its start to its end.

life_cycle  what state it is in, and why; nothing else says lost
doubts      what may contradict it
fusing      what each measurement makes of its state
report      what is published of it, and how often
"""
