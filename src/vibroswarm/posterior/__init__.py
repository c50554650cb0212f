"""The posterior of a floor whose readings depend on several tiles and on shared factors, by MCMC."""
