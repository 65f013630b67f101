!> Tells where an analysis leaves the band of frequencies in which the modulus of a material is known (`band` of &material).
module material_band
  use kinds, only: wp, pi
  use scene_run, only: run_state
  use text, only: figure_text, to_text
  implicit none (type, external)
  private
  public :: outside_band, motion_outside_band

contains

  !> Warnings, where frequencies of an analysis lie outside the band of a material that acts.
  function outside_band(run, what, frequencies) result(text)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: what              !! whose frequencies: 'modes', ...
    real(wp), intent(in) :: frequencies(:)        !! [Hz]
    character(:), allocatable :: text
    logical :: outside(size(frequencies))
    integer :: b, k
    text = ''
    do k = 1, size(run%d%materials)
      associate (band => run%d%materials(k)%band/run%d%materials(k)%law%slower)
        outside = frequencies < band(1) .or. frequencies > band(2)
        if (.not. any(outside) .or. .not. any([(feels(run, b, k), b=1, size(run%d%bodies))])) cycle
        text = text//warning(run, k, to_text(count(outside))//' of '//to_text(size(frequencies))//' '//what//', from '// &
                  figure_text(minval(frequencies, outside))//' to '//figure_text(maxval(frequencies, outside))//' Hz, lie')
      end associate
    end do
  end function outside_band

  !> Warnings, where the elastic motion of a body is slower or faster than the band of its material.
  function motion_outside_band(run) result(text)
    type(run_state), intent(in) :: run
    character(:), allocatable :: text
    real(wp) :: f                                 ! [Hz]
    integer :: b, k
    text = ''
    do b = 1, size(run%d%bodies)
      do k = 1, size(run%d%materials)
        if (.not. feels(run, b, k)) cycle
        f = run%watch%elastic_frequency(run%sys%m, b)/(2*pi)
        if (.not. f > 0.0_wp) cycle
        associate (band => run%d%materials(k)%band/run%d%materials(k)%law%slower)
          ! what lasts less than a period of the band's end looks faster than it is
          if (f < band(1) .or. (f > band(2) .and. run%sys%ev%t*band(2) >= 1.0_wp)) then
            text = text//warning(run, k, 'the elastic motion of body "'//trim(run%d%bodies(b)%name)//'", '//figure_text(f)// &
                                 ' Hz by its mean squares, lies')
          end if
        end associate
      end do
    end do
  end function motion_outside_band

  !> Whether a body bends by the terms of a material that states a band.
  pure logical function feels(run, b, k)
    type(run_state), intent(in) :: run
    integer, intent(in) :: b, k                   !! indices of body and material
    associate (body => run%d%bodies(b))
      feels = run%d%materials(k)%band(2) > 0.0_wp .and. body%kind /= 'rigid' .and. body%flexible .and. body%viscoelastic
      if (feels) feels = any(body%element_material == k) .or. any(run%sys%m%s%bodies(b)%segments%material == k)   ! of layers
    end associate
  end function feels

  !> The warning.
  function warning(run, k, what) result(text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: k                      !! index of the material
    character(*), intent(in) :: what              !! what lies outside
    character(:), allocatable :: text
    associate (m => run%d%materials(k))
      text = what//' outside the band of material "'//trim(m%label)//'", '//figure_text(m%band(1)/m%law%slower)//' to '// &
             figure_text(m%band(2)/m%law%slower)//' Hz: its modulus is not known there'//new_line('a')
    end associate
  end function warning
end module material_band
