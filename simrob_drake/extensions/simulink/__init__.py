"""Simulink models with Simscape Multibody read without MATLAB, and stations written for Simulink."""
