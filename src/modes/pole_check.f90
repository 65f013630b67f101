!> Whether the list of modes and poles is complete:
!>   all eigenvalues computed: it is complete;
!>   a larger symmetric system: its undamped modes are counted;
!>   poles of a larger system: those of the modes that are asked for.
module pole_check
  use kinds, only: wp, pi
  use dynamic_stiffness, only: stiffness_system
  use mode_list, only: mode_set, undamped_mode, real_pole
  use natural_modes, only: highest_ratio
  use text, only: to_text
  implicit none (type, external)
  private
  public :: check_undamped, check_whole, describe_searched, say_what_is_missing

  real(wp), parameter :: least_gap = 0.01_wp           !! smallest gap between squared frequencies, over the upper one [-]
  real(wp), parameter :: rounding_gap = 100*epsilon(1.0_wp) !! likewise, over the highest of all [-]
  integer, parameter :: further_modes = 5              !! modes beyond the list whose frequencies are accurate

contains

  !> Counts the undamped modes up to the highest one that is asked for.
  subroutine check_undamped(ds, whole, starts, modes)
    type(stiffness_system), intent(inout) :: ds
    logical, intent(in) :: whole                       !! all eigenvalues of the system were computed
    complex(wp), intent(in) :: starts(:)               !! all that are known, of a symmetric system in ascending order [1/s]
    type(mode_set), intent(inout) :: modes             !! the undamped ones
    real(wp) :: omega2(size(starts))                   ! [rad2/s2]
    integer :: k
    modes%note_undamped = 'undamped modes: '//to_text(modes%count)
    if (whole) then
      modes%note_undamped = modes%note_undamped//', complete, of all '//to_text(size(starts))
    else if (size(modes%unfound) > 0) then
      modes%note_undamped = modes%note_undamped//', '//to_text(size(modes%unfound))//' not found'
    else if (.not. ds%symmetric) then
      modes%note_undamped = modes%note_undamped//', not counted: there are gyroscopic terms or forces that follow the motion'
    else
      omega2 = -real(starts**2, wp)
      k = gap(omega2, count(omega2 <= maxval(-real(modes%lambda**2, wp))), rounding_gap*highest_ratio(ds))
      modes%counted = k > 0
      if (modes%counted) call count_below(ds, 0.5_wp*(omega2(k) + omega2(k + 1)), k, modes)
      if (.not. modes%counted) modes%note_undamped = modes%note_undamped//', not counted: frequencies are as close as '// &
                                                     'rounding of the stiffest motion'
    end if
  end subroutine check_undamped

  !> Compares the number of modes below a squared frequency with the number of those that are known.
  subroutine count_below(ds, sigma, known, modes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: sigma                      !! [rad2/s2]
    integer, intent(in) :: known
    type(mode_set), intent(inout) :: modes
    integer :: missing
    missing = ds%modes_below(sigma) - known
    modes%counted = missing >= 0
    if (.not. modes%counted) return
    modes%missing_undamped = missing
    modes%note_undamped = modes%note_undamped//', '
    if (missing > 0) modes%note_undamped = modes%note_undamped//to_text(missing)//' missing'
    if (missing == 0) modes%note_undamped = modes%note_undamped//'complete'
    if (sigma > 0.0_wp) modes%note_undamped = modes%note_undamped//' below '//hertz(sqrt(sigma))
  end subroutine count_below

  !> Number of the mode above which there is a gap wide enough to count in: that of the last one listed, or the next further one,
  !> or the next lower one; 0: there is none.
  pure integer function gap(omega2, last, rounding) result(k)
    real(wp), intent(in) :: omega2(:)                  !! [rad2/s2]
    integer, intent(in) :: last                        !! the last one listed
    real(wp), intent(in) :: rounding                   !! [rad2/s2]
    do k = last, min(last + further_modes, size(omega2) - 1)
      if (wide()) return
    end do
    do k = min(last, size(omega2)) - 1, 1, -1
      if (wide()) return
    end do
    k = 0
  contains
    !> Whether the gap above mode k is.
    pure logical function wide()
      wide = omega2(k + 1) - omega2(k) > max(least_gap*abs(omega2(k + 1)), rounding)
    end function wide
  end function gap

  !> Where all eigenvalues of the system were computed they are the poles, each listed or of a mode that was not asked for.
  subroutine check_whole(modes, expected, all_asked)
    type(mode_set), intent(inout) :: modes
    integer, intent(in) :: expected                    !! eigenvalues, one of each conjugate pair
    logical, intent(in) :: all_asked                   !! for all modes
    integer :: others
    others = expected - count(modes%kind /= undamped_mode)
    if (all_asked .or. others < 0) modes%missing = others
    if (modes%missing /= 0) then
      modes%note_damped = 'poles: '//number_listed(modes)//', '//to_text(others)//' missing'
    else if (others == 0) then
      modes%note_damped = 'poles: complete, all '//number_listed(modes)
    else
      modes%note_damped = 'poles: '//number_listed(modes)//', complete, '//to_text(others)//' of modes not asked for left out'
    end if
  end subroutine check_whole

  !> A larger system is searched for the poles of the modes that are asked for. With gyroscopic terms rigid motions take part in all
  !> relaxations of a material: many poles lie close together, and only some are found.
  subroutine describe_searched(symmetric, modes)
    logical, intent(in) :: symmetric                   !! the undamped system
    type(mode_set), intent(inout) :: modes
    modes%note_damped = 'poles: '//number_listed(modes)//', those of the modes asked for, residuals at most '// &
                        to_text(maxval([0.0_wp, modes%residual]))
    if (.not. symmetric .and. any(modes%kind == real_pole)) modes%note_damped = modes%note_damped// &
      '; of the relaxations not all: there are gyroscopic terms or forces that follow the motion'
    if (modes%not_converged > 0) modes%note_damped = modes%note_damped//'; '//to_text(modes%not_converged)// &
                                                 ' searches for further ones did not settle'
  end subroutine describe_searched

  !> How many poles are listed, in words.
  function number_listed(modes) result(words)
    type(mode_set), intent(in) :: modes
    character(:), allocatable :: words
    logical :: damped(modes%count)
    damped = modes%kind /= undamped_mode
    words = to_text(count(damped) + count(damped .and. modes%lambda%im > 0.0_wp))//' with conjugates'
  end function number_listed

  !> The sentence on what is missing in the list; empty where nothing is known to be missing.
  subroutine say_what_is_missing(modes, failed, words)
    type(mode_set), intent(in) :: modes
    logical, intent(out) :: failed                     !! modes that were asked for are missing
    character(:), allocatable, intent(out) :: words
    integer :: k
    failed = size(modes%unfound) > 0 .or. modes%missing_undamped > 0
    words = ''
    if (failed) then
      words = 'the modal analysis has not found all modes that were asked for: '//modes%note_undamped
      do k = 1, size(modes%unfound)
        words = words//', one near '//hertz(abs(modes%unfound(k)))
      end do
    else if (modes%missing /= 0 .or. modes%not_converged > 0) then
      words = 'poles may be missing in modes.txt: '//modes%note_damped
    else if (.not. modes%counted) then
      words = 'modes.txt may not be complete: '//modes%note_undamped
    end if
  end subroutine say_what_is_missing

  !> A modulus as a frequency.
  pure function hertz(modulus) result(text)
    real(wp), intent(in) :: modulus                    !! [rad/s]
    character(:), allocatable :: text
    text = to_text(modulus/(2*pi))//' Hz'
  end function hertz
end module pole_check
