"""Messages and arrays: conversion both ways."""
