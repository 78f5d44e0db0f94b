"""MFEM as a black box: ``solver`` runs in processes of its own, ``code`` says where it is."""
