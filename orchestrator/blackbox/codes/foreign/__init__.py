"""Parts whose mesh is not ours, as codes: all that is asked of them is a stiffness on their joints and loads there.

``condensed`` says what a part is once it is brought to its joints, and judges it; ``matrix`` and ``calculix_deck`` bring
parts there; ``code`` and ``algebra`` answer for them: the search direction is added to the condensed stiffness, here, and
factorised once. No process stays alive.
"""
