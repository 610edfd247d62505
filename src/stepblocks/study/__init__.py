"""Who feels it: designs and analyses of the experiments on people; sees identities, heights and energies, nothing else."""
