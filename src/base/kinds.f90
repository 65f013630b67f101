!> The one real kind of the program and a few universal constants.
module kinds
  use, intrinsic :: iso_fortran_env, only: real64, int64
  implicit none (type, external)
  private

  integer, parameter, public :: wp = real64   !! working precision of every real
  integer, parameter, public :: number = wp   !! of values that are complex in a module's complex twin (`make`, TWINS)
  integer, parameter, public :: ip = int64    !! long integers: steps and evaluation counts
  integer(ip), parameter, public :: low = 4294967295_ip   !! mask of the lower half of such an integer
  real(wp), parameter, public :: half_digits = sqrt(epsilon(1.0_wp))   !! what differs by less, of its size, counts as the same [-]
  real(wp), parameter, public :: pi = acos(-1.0_wp)   !! [-]
end module kinds
