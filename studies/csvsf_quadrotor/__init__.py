"""Al-Shabi, Gadsden and Wilkerson: smooth variable structure filters on a quadrotor.

`study` runs it.
"""
