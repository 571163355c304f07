"""Experiments with an effect hidden in them, to practise on and to test the diagnosis with.

Nothing of the diagnosis' own simulator is used: robot, water, disturbance and instruments are made
here, and the answer is sealed in a file that the diagnosis never reads.
"""
