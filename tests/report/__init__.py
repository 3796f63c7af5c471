"""`./run report`: how good the weights are that skind finds, measured over the wire and shown.

    characters   rigs with their own weights as the truth, all as if 2 m long
    damage       what is done to these weights, to be won back
    brush        what an artist does to a posed surface
    session      a session of the daemon, as a user's script would use it
    figures/     one module for each question of the closing table
    tables, sweeps, pictures, page
"""
