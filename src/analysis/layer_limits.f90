!> Where the theory of layered beams ends (theory.md, section 16), for waves of a frequency: layers that would shear by themselves,
!> cores that would give way across, cores that are stiff beside their faces.
module layer_limits
  use kinds, only: wp, pi
  use body, only: body_model
  use layered_section, only: layered_section_model, section_layer
  use text, only: either, figure_text
  implicit none (type, external)
  private
  public :: body_sentence, modulus_ratio, thick_layers, stiff_core

  real(wp), parameter, public :: told = 0.01_wp      !! error of a frequency or loss factor that is told [-]
  real(wp), parameter :: stretched_core = 3.0e-4_wp  !! of a face: a loss factor errs by about twice as much [-]

contains

  !> Warnings of a body for waves of a frequency; empty where there are none.
  function thick_layers(body, omega) result(text)
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: omega                    !! [rad/s]
    character(:), allocatable :: text
    real(wp) :: height, soft, across                 ! largest of all sections; a loss errs by 4 height**2, by across**2 [-]
    real(wp) :: half, x(3)                           ! half a wave [m]
    integer :: e
    logical :: bonded, alone                         ! the highest section has no cores; it is one layer
    text = ''
    if (.not. (omega > 0.0_wp .and. omega < huge(1.0_wp))) return
    height = 0.0_wp
    soft = 0.0_wp
    across = 0.0_wp
    bonded = .false.
    alone = .false.
    do e = 1, body%ne
      associate (s => body%layers%sections(body%layers%kinds(body%layers%kind(e))%section))
        half = pi/sqrt(omega*sqrt(sum(s%layers%density*s%layers%area)/s%bending))
        if (s%cores > 0) half = min(half, covered_span(body, e))
        x = figures(body, s, half, omega)
        if (x(1) > height) bonded = s%cores == 0
        if (x(1) > height) alone = size(s%layers) == 1
        height = max(height, x(1))
        soft = max(soft, x(2))
        across = max(across, x(3))
      end associate
    end do
    if (4*height**2 > told) text = text//body_sentence(body, '', either('has a section that is', &
      'has bonded layers that together are', alone)//' as thick as', 100*height, '% of half a wave'// &
      either('', ', or of a cover', alone)//': beyond 5 % '//either('it shears', 'they shear', alone)// &
      ', which is left out'//either(' (shear=.true. has it)', '', bonded))
    if (soft > 1.0_wp) text = text//body_sentence(body, '', 'has a bonded layer whose modulus, over that of another '// &
      'one, is', 1/soft, 'of (thickness over half a wave) squared: below 1 it shears and gives way across, and no theory of '// &
      'beams tells its damping')
    if (across**2 > told) text = text//body_sentence(body, '', 'has a core that gives way across: the motion is as fast as', &
      across, 'of the resonance of its faces on its thickness; beyond 0.1 its loss factor errs by more than 1 %')
  end function thick_layers

  !> Of a section: thickness of bonded layers over half a wave; what of the modulus a soft one would need beside another one over
  !> what it has; the frequency over that of the faces on a core's thickness.
  pure function figures(body, s, half, omega) result(x)
    type(body_model), intent(in) :: body
    type(layered_section_model), intent(in) :: s
    real(wp), intent(in) :: half                     !! a wave [m]
    real(wp), intent(in) :: omega                    !! [rad/s]
    real(wp) :: x(3)                                 !! [-]
    real(wp) :: below, above, height, young(size(s%layers))   ! masses [kg/m2], [m], [Pa]
    integer :: first, last, l
    x = 0.0_wp
    do l = 1, size(young)
      young(l) = s%layers(l)%young*real(modulus_ratio(body, s%layers(l), omega), wp)
    end do
    above = 0.0_wp
    last = 0
    do while (last < size(young))
      first = last + 1
      do last = first, size(young) - 1               ! layers first to last are bonded
        if (s%layers(last + 1)%core > 0) exit
      end do
      last = min(last, size(young))
      below = above
      associate (group => s%layers(first:last))
        height = sum(group%thickness)
        if (first == last) height = sqrt(12*group(1)%second/group(1)%area)
        above = sum(group%density*group%thickness)
      end associate
      if (.not. s%shears) x(1) = max(x(1), height/half)
      x(2) = max(x(2), maxval(young(first:last))/minval(young(first:last))*(height/half)**2)
      if (first > 2) x(3) = max(x(3), omega/sqrt(young(first - 1)/s%layers(first - 1)%thickness*(1/below + 1/above)))
      last = last + 1                                ! the core
    end do
  end function figures

  !> E(i omega)/E_R of a layer.
  pure complex(wp) function modulus_ratio(body, layer, omega) result(ratio)   ! [-]
    type(body_model), intent(in) :: body
    type(section_layer), intent(in) :: layer
    real(wp), intent(in) :: omega                    !! [rad/s]
    integer :: r
    ratio = 1.0_wp
    if (.not. layer%follows) return
    r = findloc(body%segments%material, layer%material, 1)
    if (r > 0) ratio = 1 + body%segments(r)%law%ratio(cmplx(0.0_wp, omega, wp))
  end function modulus_ratio

  !> Length of the neighbouring elements with cores about one.
  pure real(wp) function covered_span(body, e) result(span)   ! [m]
    type(body_model), intent(in) :: body
    integer, intent(in) :: e                         !! element
    integer :: first, last
    do first = e, 2, -1
      if (.not. covered(first - 1)) exit
    end do
    do last = e, body%ne - 1
      if (.not. covered(last + 1)) exit
    end do
    span = sum(body%elements(first:min(last, body%ne))%length)
  contains
    !> Whether an element has cores.
    pure logical function covered(k)
      integer, intent(in) :: k
      covered = body%layers%kinds(body%layers%kind(k))%coordinates > 6
    end function covered
  end function covered_span

  !> A warning of cores that are stiff: what a viscoelastic one stores in its stretch over that of the thinner layer beside it.
  function stiff_core(body) result(text)
    type(body_model), intent(in) :: body
    character(:), allocatable :: text
    real(wp) :: ratio                                ! [-]
    integer :: k, l
    text = ''
    ratio = 0.0_wp
    do k = 1, size(body%layers%sections)
      associate (s => body%layers%sections(k), ea => body%layers%sections(k)%layers%young*body%layers%sections(k)%layers%area)
        do l = 2, size(ea) - 1
          if (s%layers(l)%core == 0 .or. s%core_stretch .or. .not. s%layers(l)%follows) cycle
          ratio = max(ratio, ea(l)/min(ea(l - 1), ea(l + 1)))
        end do
      end associate
    end do
    if (ratio > stretched_core) text = body_sentence(body, '', 'has a core that would store in its stretch', 100*ratio, &
      '% of what a face beside it does: its viscoelastic terms act on its shear alone (core_stretch=.true.: on all of it)')
  end function stiff_core

  !> A warning of a body with a figure.
  function body_sentence(body, stage, what, x, rest) result(text)
    type(body_model), intent(in) :: body
    character(*), intent(in) :: stage                !! words that go before the body: in which analysis
    character(*), intent(in) :: what, rest
    real(wp), intent(in) :: x   !! figure of the sentence [-], [rad] or [rad/s]
    character(:), allocatable :: text
    text = stage//'body "'//trim(body%name)//'" '//what//' '//figure_text(x)//' '//rest//new_line('a')
  end function body_sentence
end module layer_limits
