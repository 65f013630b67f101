!> What several groups of a deck have in common.
module deck_parts
  use kinds, only: wp
  use deck_origin, only: name_length
  implicit none (type, external)
  private

  !> A marker on a body: a node of a beam or frame, or a point of a rigid body or of the ground.
  type, public :: marker_record
    integer :: body = 0                      !! 0: ground
    integer :: node = 0                      !! positive (-1 already resolved); 0: a point, or the body's frame itself
    real(wp) :: share = -1.0_wp              !! `at` as it is read, of the length of a beam; -1: not given [-]
    real(wp) :: point(2) = 0.0_wp            !! in body axes [m]; 0 where a node is named
  end type marker_record

  !> Viscoelastic terms of a material or a spring; size 0: no such terms.
  type, public :: law_record
    real(wp), allocatable :: ghm_alpha(:)    !! [-]
    real(wp), allocatable :: ghm_zeta(:)     !! [-]
    real(wp), allocatable :: ghm_omega(:)    !! [rad/s], ghm_frequency_scale already applied
    real(wp), allocatable :: prony_alpha(:)  !! [-]
    real(wp), allocatable :: prony_tau(:)    !! [s], ghm_frequency_scale already applied
    real(wp) :: wlf(2) = 0.0_wp              !! C1 [-], C2 [K]; 0: no such law
    real(wp) :: arrhenius = 0.0_wp           !! activation energy, 0: no such law [J/mol]
    real(wp) :: vertical = 0.0_wp            !! change of the modulus [1/K]
    real(wp) :: reference = 0.0_wp           !! temperature of what the group states [C]
    real(wp) :: temperature = huge(1.0_wp)   !! at which it is used; huge: the reference [C]
    real(wp) :: slower = 1.0_wp              !! a_T: times at that temperature over those of the group [-]
    real(wp) :: stiffer = 1.0_wp             !! b_T: the same of modulus or stiffness [-]
  end type law_record

  !> A column of a sensor that is a quantity of motion, as other groups name it: `tip.x`.
  type, public :: column_record
    integer :: sensor = 0                    !! index of the sensor; 0: none is named
    character(name_length) :: suffix = ''    !! `.x`; blank: the sensor's only column
    integer :: number = 0                    !! of it among the sensor's columns of motion (`deck_columns`)
  end type column_record
end module deck_parts
