!> Reader of &profile, and what joints and stops say of their pairs.
module deck_profiles
  use kinds, only: wp
  use deck_histories, only: read_lists
  use deck_input, only: deck_source
  use deck_records, only: deck_record => deck, profile_record
  use deck_take, only: take
  use text, only: either, quoted, to_text
  implicit none (type, external)
  private
  public :: check_follower, read_profile

contains

  !> &profile
  subroutine read_profile(deck, r)
    class(deck_source), intent(inout) :: deck
    type(profile_record), intent(inout) :: r
    call take(deck, r)
    if (deck%is_choice('points')) call check_points(deck, r)
    if (deck%is_choice('law')) call check_law(deck, r)
  end subroutine read_profile

  !> Points, of the deck or of a file: no two of them in one place.
  subroutine check_points(deck, r)
    class(deck_source), intent(inout) :: deck
    type(profile_record), intent(inout) :: r
    real(wp), allocatable :: chord(:)             ! between neighbours [m]
    integer :: k, least
    call read_lists(deck, 'x', 'y', r%file, r%columns, r%x, r%y)
    if (.not. (deck%is_clean() .and. (deck%is_set('x') .or. deck%is_set('file'))) .or. size(r%x) /= size(r%y)) return   ! it is told
    least = merge(3, 2, r%closed)
    if (size(r%x) < least) then
      call deck%complain(either('file', 'x', deck%is_given('file')), 'the profile has '//to_text(size(r%x))// &
                         ' points, expected at least '//to_text(least))
      return
    end if
    chord = hypot(r%x(2:) - r%x(:size(r%x) - 1), r%y(2:) - r%y(:size(r%y) - 1))
    k = findloc(chord <= 4*epsilon(1.0_wp)*sum(chord), .true., 1)
    if (k > 0) call deck%complain(either('file', 'x', deck%is_given('file')), 'points '//to_text(k)//' and '//to_text(k + 1)// &
      ' of the profile coincide beside its length of '//to_text(sum(chord))//', expected each once')
  end subroutine check_points

  !> The law of a roller, of an arm or of a face.
  subroutine check_law(deck, r)
    class(deck_source), intent(inout) :: deck
    type(profile_record), intent(in) :: r
    if (r%follower == 'flat') then
      call deck%refuse('radius offset arm', ' does not apply to follower=''flat'', expected it without')
      call deck%need('base_radius')
    else if (deck%is_given('arm') .or. deck%is_given('pivot')) then
      call deck%refuse('base_radius offset', ' does not apply to a roller on an arm, expected it without')
      call deck%need('arm')
      call deck%need('pivot')
      call deck%need('radius')
    else
      call deck%need('base_radius')
      call deck%need('radius')
      if (deck%is_clean() .and. .not. abs(r%offset) < r%base_radius + r%radius) call deck%complain('offset', 'offset='// &
        to_text(r%offset)//' is beyond the roller''s path, expected less than base_radius + radius, '// &
        to_text(r%base_radius + r%radius))
    end if
  end subroutine check_law

  !> The follower of a joint or stop: a roller or a face, which the profile has to suit.
  subroutine check_follower(deck, d, profile, radius)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d            !! its profiles are read
    integer, intent(in) :: profile                !! 0: none
    real(wp), intent(in) :: radius                !! of the roller [m]
    if (profile == 0 .or. .not. deck%is_choice('profile')) return
    associate (r => d%profiles(profile))
      if (deck%is_given('face') .and. r%kind == 'points' .and. .not. r%closed) call deck%complain('face', 'a flat face does '// &
        'not touch the open profile '//quoted(trim(r%name))//', expected radius, or closed=.true.')
      if (.not. r%hollow) return
      if (deck%is_given('face')) call deck%complain('face', 'a flat face cannot touch the inside of the hollow profile '// &
        quoted(trim(r%name))//', expected radius, or a profile that is not hollow')
      if (radius >= r%radius) call deck%complain('radius', 'radius='//to_text(radius)//' does not fit into the hollow profile '// &
        quoted(trim(r%name))//', expected less than its radius, '//to_text(r%radius))
    end associate
  end subroutine check_follower
end module deck_profiles
